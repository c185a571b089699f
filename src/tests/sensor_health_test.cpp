#include "scene/sensor_health.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <optional>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::Random;

using Points = std::vector<Eigen::Vector3f>;

// A yard of 15 to 40 m with walls of different distance, ground before them and the sky above; the
// rays of each frame are drawn anew.
class Yard {
 public:
  explicit Yard(std::uint32_t seed, double turned_rad = 0.0)
      : random_(seed), turned_rad_(turned_rad) {}

  // Beams that point up, level and down in equal parts.
  Points Frame(int rays = 2000) {
    Points points_m;
    for (int i = 0; i < rays; ++i) {
      const Eigen::Vector3d ray = Ray();
      const std::optional<double> range_m = RangeAlong(ray);
      if (range_m) points_m.push_back((*range_m * ray).cast<float>());
    }
    return points_m;
  }

  // Returns of so many rays whose ranges come from `draw`.
  Points Strays(int rays, const std::function<double(Random*)>& draw) {
    Points points_m;
    for (int i = 0; i < rays; ++i) points_m.push_back((draw(&random_) * Ray()).cast<float>());
    return points_m;
  }

  Random* random() { return &random_; }

 private:
  Eigen::Vector3d Ray() {
    const double azimuth = random_.Uniform(-M_PI, M_PI);
    const double sine = random_.Uniform(-0.15, 0.8);
    const double level = std::sqrt(1.0 - sine * sine);
    return {level * std::cos(azimuth), level * std::sin(azimuth), sine};
  }

  std::optional<double> RangeAlong(const Eigen::Vector3d& ray) {
    constexpr double kGroundM = -2.0;
    constexpr double kWallM = 4.0;
    const double side = std::floor((std::atan2(ray.y(), ray.x()) + turned_rad_ + 7.0) * 4.0);
    const double wall_m = 15.0 + 5.0 * std::fmod(side, 6.0);
    const double level = std::hypot(ray.x(), ray.y());
    const double height_m = wall_m / level * ray.z();
    double range_m = wall_m / level;
    if (height_m > kWallM) return std::nullopt;
    if (height_m < kGroundM) range_m = kGroundM / ray.z();
    return range_m + random_.Normal(0.02);
  }

  Random random_;
  double turned_rad_;
};

// Fog: gamma distributed ranges of shape 2.
double FogRangeM(Random* random) {
  return 0.5 - 2.5 * std::log(random->Uniform(0.0, 1.0) * random->Uniform(0.0, 1.0));
}

// A sensor at some place, of 10 frames a second; tells when it was blinded.
class Watched {
 public:
  Watched() { sensor.origin_m = {100.0F, -40.0F, 8.0F}; }

  // Frames of so many seconds. Returns the seconds of them in which it was blinded.
  double Snapshot(double seconds, const std::function<Points()>& frame) {
    int blinded = 0;
    const int count = static_cast<int>(std::lround(10.0 * seconds));
    for (int i = 0; i < count; ++i, time_ns_ += testing::kPeriodNs) {
      Points points_m = frame();
      for (Eigen::Vector3f& point_m : points_m) point_m += sensor.origin_m;
      sensor_health.AddFrame(sensor, time_ns_, points_m);
      blinded += sensor_health.is_blinded() ? 1 : 0;
    }
    return 0.1 * blinded;
  }

  void Pause(double seconds) { time_ns_ += std::llround(1e9 * seconds); }

  SensorInfo sensor;
  SensorHealth sensor_health;

 private:
  TimeNs time_ns_ = kBeginNs;
};

Points operator+(Points a, const Points& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

// Those that are nearer than a range.
Points Within(double range_m, const Points& points_m) {
  Points near_m;
  for (const Eigen::Vector3f& point_m : points_m) {
    if (static_cast<double>(point_m.norm()) < range_m) near_m.push_back(point_m);
  }
  return near_m;
}

TEST(SensorHealth, IsClearInClearAirWithPeopleACarAndAFewDrops) {
  Yard yard(1);
  Watched watched;
  double time_s = 0.0;
  const double blinded_s = watched.Snapshot(60.0, [&] {
    time_s += 0.1;
    // A car of 4 m passes 6 m before the sensor, hides what is behind, and stops there for a while.
    const double way_m = std::clamp(8.0 * (time_s - 20.0), -80.0, 0.0);
    const Eigen::Vector3d car_m(6.0, way_m, -1.2);
    Points car = yard.Strays(300, [](Random*) { return 1.0; });
    for (Eigen::Vector3f& ray : car) {
      ray = (car_m + yard.random()->InBox({0.0, -2.0, -0.8}, {0.0, 2.0, 0.8})).cast<float>();
    }
    return yard.Frame() + car + yard.Strays(30, FogRangeM);
  });
  EXPECT_EQ(blinded_s, 0.0);
  EXPECT_EQ(watched.sensor_health.blinded_s(), 0.0);
}

TEST(SensorHealth, IsBlindedWhereItSeesLittleOfItsStructureAndSeesAgainWhenThatIsBack) {
  Yard yard(2);
  Watched watched;
  EXPECT_EQ(watched.Snapshot(20.0, [&] { return yard.Frame(); }), 0.0);
  // What is within 17 m is left: the ground and some walls.
  EXPECT_NEAR(watched.Snapshot(20.0, [&] { return Within(17.0, yard.Frame()); }), 17.0, 1.0);
  EXPECT_NEAR(watched.Snapshot(20.0, [&] { return yard.Frame(); }), 3.0, 1.0);
  EXPECT_NEAR(watched.sensor_health.blinded_s(), 20.0, 1.5);
}

TEST(SensorHealth, AHandBeforeItForTwoSecondsIsNoWeather) {
  Yard yard(3);
  Watched watched;
  watched.Snapshot(20.0, [&] { return yard.Frame(); });
  EXPECT_EQ(watched.Snapshot(2.0, [] { return Points(); }), 0.0);
  EXPECT_EQ(watched.Snapshot(20.0, [&] { return yard.Frame(); }), 0.0);
}

TEST(SensorHealth, IsBlindedWhereNothingReturnsThoughFramesCome) {
  Yard yard(4);
  Watched watched;
  watched.Snapshot(20.0, [&] { return yard.Frame(); });
  EXPECT_NEAR(watched.Snapshot(10.0, [] { return Points(); }), 7.0, 1.0);
}

TEST(SensorHealth, ThatItsSkyReturnsNothingFromTheBeginningIsNoSign) {
  Watched watched;
  EXPECT_EQ(watched.Snapshot(60.0, [] { return Points(); }), 0.0);
}

TEST(SensorHealth, FogIsToldFromTheBeginningAndWhenItComes) {
  Yard yard(5);
  const auto in_fog = [&](int strays) {
    return [&yard, strays] { return yard.Frame() + yard.Strays(strays, FogRangeM); };
  };
  Watched always;
  EXPECT_NEAR(always.Snapshot(20.0, in_fog(1000)), 17.0, 1.0);
  EXPECT_NEAR(always.Snapshot(20.0, [&] { return yard.Frame(); }), 3.0, 1.0);
  Watched later;
  EXPECT_EQ(later.Snapshot(20.0, in_fog(0)), 0.0);
  EXPECT_NEAR(later.Snapshot(20.0, in_fog(1000)), 17.0, 1.0);
  Watched light;
  EXPECT_EQ(light.Snapshot(20.0, in_fog(300)), 0.0);
}

TEST(SensorHealth, ACoveredWindowIsToldFromTheBeginning) {
  Yard yard(6);
  const auto window = [](Random* random) { return random->Uniform(0.5, 0.9); };
  Watched watched;
  EXPECT_NEAR(watched.Snapshot(20.0, [&] { return yard.Strays(1500, window); }), 17.0, 1.0);
  // However long it lasts: the window is no structure.
  EXPECT_NEAR(watched.Snapshot(60.0, [&] { return yard.Strays(1500, window); }), 60.0, 0.1);
}

TEST(SensorHealth, ASensorThatWasTurnedOrMovedKnowsItsNewSurroundingsAfterAWhile) {
  Yard yard(7);
  Yard elsewhere(8, 0.9);
  Watched watched;
  watched.Snapshot(30.0, [&] { return yard.Frame(); });
  const double blinded_s = watched.Snapshot(60.0, [&] { return elsewhere.Frame(); });
  EXPECT_GT(blinded_s, 20.0);
  EXPECT_LT(blinded_s, 40.0);
  EXPECT_FALSE(watched.sensor_health.is_blinded());
}

TEST(SensorHealth, FogThatLastsNeverBecomesWhatItShouldSee) {
  Yard yard(9);
  Watched watched;
  watched.Snapshot(30.0, [&] { return yard.Frame(); });
  watched.Snapshot(5.0, [&] { return Within(16.0, yard.Frame()); });
  EXPECT_NEAR(watched.Snapshot(120.0, [&] { return Within(16.0, yard.Frame()); }), 120.0, 0.1);
}

TEST(SensorHealth, ThroughAPauseItRemembersWhatItShouldSee) {
  Yard yard(10);
  Watched watched;
  watched.Snapshot(20.0, [&] { return yard.Frame(); });
  watched.Pause(3600.0);
  EXPECT_NEAR(watched.Snapshot(10.0, [&] { return Within(17.0, yard.Frame()); }), 7.0, 1.0);
}

}  // namespace
}  // namespace unlidar
