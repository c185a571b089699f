#include "scene/pose_check.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "tests/draws.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::Random;

using Points = std::vector<Eigen::Vector3f>;
using Pose = Eigen::Isometry3d;  // of the sensor, in the world

// A village: ground, house walls and trunks at random places; each frame hits them at others.
class Village {
 public:
  explicit Village(std::uint32_t seed) : random_(seed) {
    for (int i = 0; i < 1000; ++i) {
      const Eigen::Vector3d foot = random_.InBox({-200, -200, kGroundM}, {200, 200, kGroundM});
      const bool is_house = i % 4 == 0;
      const bool is_along_x = i % 8 == 0;
      const double long_m = is_house ? random_.Uniform(5.0, 12.0) : 0.4;
      const Eigen::Vector3d size(is_along_x ? long_m : 0.4, is_along_x ? 0.4 : long_m, 5.0);
      if (foot.head<2>().norm() > 5.0) things_.push_back({foot, size});
    }
  }

  // Returns as the sensor gives them. `walkers`: people who walk about.
  Points Frame(double time_s, const Pose& pose, int walkers = 0) {
    Points points_m;
    const auto add = [&](const Eigen::Vector3d& world_m) {
      const Eigen::Vector3d seen_m = pose.inverse() * world_m;
      if (seen_m.norm() < 60.0) points_m.push_back(seen_m.cast<float>());
    };
    const Eigen::Vector3d at_m = pose.translation();
    for (int i = 0; i < 1500; ++i) {
      const double range_m = random_.Uniform(3.0, 50.0);
      const double azimuth = random_.Uniform(-M_PI, M_PI);
      add({at_m.x() + range_m * std::cos(azimuth), at_m.y() + range_m * std::sin(azimuth),
           kGroundM + random_.Normal(0.02)});
    }
    for (const Thing& thing : things_) {
      if ((thing.foot_m - at_m).norm() > 60.0) continue;
      for (int i = 0; i < 15; ++i) add(random_.InBox(thing.foot_m, thing.foot_m + thing.size_m));
    }
    for (int k = 0; k < walkers; ++k) {
      const Eigen::Vector3d foot_m(6.0 + 3.0 * k - 1.4 * time_s, 4.0 + 2.0 * k, kGroundM);
      for (int i = 0; i < 40; ++i) {
        add(random_.InBox(foot_m, foot_m + Eigen::Vector3d(0.5, 0.5, 1.7)));
      }
    }
    return points_m;
  }

  Random* random() { return &random_; }

 private:
  static constexpr double kGroundM = -2.0;

  struct Thing {
    Eigen::Vector3d foot_m;
    Eigen::Vector3d size_m;
  };

  Random random_;
  std::vector<Thing> things_;
};

Pose At(const Eigen::Vector3d& place_m, double turn_deg = 0.0) {
  Pose pose = Pose::Identity();
  pose.translate(place_m);
  pose.rotate(Eigen::AngleAxisd(turn_deg * M_PI / 180.0, Eigen::Vector3d::UnitZ()));
  return pose;
}

Pose Still(double /*time_s*/) { return Pose::Identity(); }

// The codes of what is said of 10 frames a second.
std::vector<std::string> CodesOf(const std::function<Points(double)>& frame_at, double seconds,
                                 const void* carrier = nullptr) {
  PoseCheck check;
  SensorInfo sensor;
  sensor.name = "roof";
  sensor.carrier = carrier;
  for (int i = 0; i * 0.1 < seconds; ++i) {
    const Points points_m = frame_at(i * 0.1);
    check.AddFrame(sensor, kBeginNs + i * kPeriodNs, points_m);
  }
  check.Finish();
  std::vector<std::string> codes;
  for (const Warning& warning : check.WarningsOf("roof")) {
    codes.push_back(warning.code);
    EXPECT_EQ(warning.text.substr(0, 6), "roof: ");
  }
  return codes;
}

std::vector<std::string> CodesOfMotion(const std::function<Pose(double)>& pose_at, int walkers,
                                       std::uint32_t seed, double seconds = 15.0) {
  Village village(seed);
  return CodesOf([&](double t) { return village.Frame(t, pose_at(t), walkers); }, seconds);
}

using Codes = std::vector<std::string>;

TEST(PoseCheck, SaysNothingOfASensorThatStandsWithZUp) {
  for (std::uint32_t seed = 1; seed <= testing::Draws(5U); ++seed) {
    EXPECT_EQ(CodesOfMotion(Still, 0, seed), Codes());
    EXPECT_EQ(CodesOfMotion(Still, 4, seed), Codes());
  }
}

TEST(PoseCheck, SaysNothingOfAMastThatSways) {
  const auto sway = [](double t) {
    Pose pose = Pose::Identity();
    pose.rotate(Eigen::AngleAxisd(0.003 * std::sin(3.0 * t), Eigen::Vector3d::UnitX()));
    return pose;
  };
  EXPECT_EQ(CodesOfMotion(sway, 2, 1), Codes());
}

TEST(PoseCheck, SaysThatASensorMoves) {
  const std::vector<std::function<Pose(double)>> motions = {
      [](double t) {
        return At({1.5 * t, 0, 0});
      },  // carried
      [](double t) {
        return At({0.5 * t, 0, 0});
      },  // creeping
      [](double t) {
        return At({10.0 * t, 0, 0});
      },  // on a car
      [](double t) {
        return At({25.0 * t, 0, 0});
      },
      [](double t) {
        return At({0, 0, 0}, 30.0 * t);
      },  // panning
      [](double t) {
        return At({0, 0, 0}, 3.0 * t);
      },
      [](double t) {
        return At({5.0 * t, 0.5 * t, 0}, 8.0 * t);
      },  // on a car in a bend
      [](double t) {
        return At({t < 5.0 ? 0.0 : 8.0 * (t - 5.0), 0, 0});
      },
  };
  for (std::size_t i = 0; i < motions.size(); ++i) {
    for (std::uint32_t seed = 1; seed <= testing::Draws(3U); ++seed) {
      EXPECT_EQ(CodesOfMotion(motions[i], 2, seed), Codes{"sensor_moves"}) << i << " " << seed;
    }
  }
}

TEST(PoseCheck, SaysNothingOfTheMotionOfASensorWithPoses) {
  Village village(1);
  const auto on_a_car = [&](double t) { return village.Frame(t, At({10.0 * t, 0, 0}), 2); };
  const int carrier = 0;
  EXPECT_EQ(CodesOf(on_a_car, 15.0, &carrier), Codes());
}

TEST(PoseCheck, SaysWhichWayIsUpWhereZIsNot) {
  const auto turned = [](const Eigen::Vector3d& axis, double angle_deg) {
    return [=](double) {
      Pose pose = Pose::Identity();
      pose.rotate(Eigen::AngleAxisd(angle_deg * M_PI / 180.0, axis.normalized()));
      return pose;
    };
  };
  for (std::uint32_t seed = 1; seed <= testing::Draws(3U); ++seed) {
    EXPECT_EQ(CodesOfMotion(turned({1, 0, 0}, 180), 2, seed), Codes{"upside_down"});
    EXPECT_EQ(CodesOfMotion(turned({0.3, 1, 0}, 180), 2, seed), Codes{"upside_down"});
    EXPECT_EQ(CodesOfMotion(turned({1, 0, 0}, 90), 2, seed), Codes{"z_not_up"});
    EXPECT_EQ(CodesOfMotion(turned({0, 1, 0}, -90), 2, seed), Codes{"z_not_up"});
    EXPECT_EQ(CodesOfMotion(turned({1, 1, 0}, 50), 2, seed), Codes{"z_not_up"});
    EXPECT_EQ(CodesOfMotion(turned({0, 0, 1}, 90), 2, seed), Codes());
    EXPECT_EQ(CodesOfMotion(turned({1, 0, 0}, 8), 2, seed), Codes());
  }
}

TEST(PoseCheck, SaysNothingWhereThereIsNothingToTellItBy) {
  Random random(1);
  const auto strays = [&](double) {
    Points points_m;
    for (int i = 0; i < 100; ++i) {
      points_m.push_back((random.Uniform(2.0, 400.0) *
                          (Eigen::Vector3d(0, 0, 1.2) + random.NormalVector(0.3)).normalized())
                             .cast<float>());
    }
    return points_m;
  };
  EXPECT_EQ(CodesOf(strays, 20.0), Codes());
  EXPECT_EQ(CodesOf([](double) { return Points(); }, 20.0), Codes());
  const auto fog = [&](double) {
    Points points_m;
    for (int i = 0; i < 3000; ++i) {
      const double range_m = -4.0 * std::log(random.Uniform(0.0, 1.0) * random.Uniform(0.0, 1.0));
      points_m.push_back((range_m * random.NormalVector(1.0).normalized()).cast<float>());
    }
    return points_m;
  };
  EXPECT_EQ(CodesOf(fog, 20.0), Codes());
}

TEST(PoseCheck, SaysNothingOfAWallThatIsAllThatIsSeen) {
  Random random(1);
  const auto wall = [&](double) {
    Points points_m;
    for (int i = 0; i < 3000; ++i) {
      points_m.push_back(random.InBox({15.0, -25.0, 0.0}, {15.05, 25.0, 25.0}).cast<float>());
    }
    return points_m;
  };
  EXPECT_EQ(CodesOf(wall, 15.0), Codes());
}

// Returns of a Mid-360, which looks up, 1.5 m above a floor and under a ceiling of half so wide.
Points UnderACeiling(double half_m, double ceiling_m, bool has_walls, Random* random) {
  Points points_m;
  for (int i = 0; i < 1100; ++i) {
    const double elevation = random->Uniform(-7.0, 52.0) * M_PI / 180.0;
    const double azimuth = random->Uniform(-M_PI, M_PI);
    const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                              std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
    const double wall_m = half_m / ray.head<2>().cwiseAbs().maxCoeff();
    double range_m = ray.z() < 0.0 ? -1.5 / ray.z() : (ceiling_m - 1.5) / ray.z();
    if (has_walls) range_m = std::min(range_m, wall_m);
    const bool is_open = !has_walls && ray.z() >= 0.0 && range_m > wall_m;
    if (is_open || range_m > 60.0) continue;
    points_m.push_back(((range_m + random->Normal(0.02)) * ray).cast<float>());
  }
  return points_m;
}

TEST(PoseCheck, SaysNothingInAHallOrUnderARoofWhoseFloorIsSeen) {
  Random random(1);
  for (const double ceiling_m : {4.0, 6.0, 10.0}) {
    for (const double half_m : {15.0, 20.0, 30.0, 50.0}) {
      for (const bool has_walls : {true, false}) {
        const auto frame = [&](double) {
          return UnderACeiling(half_m, ceiling_m, has_walls, &random);
        };
        EXPECT_EQ(CodesOf(frame, 6.0), Codes()) << half_m << " " << ceiling_m << " " << has_walls;
      }
    }
  }
}

}  // namespace
}  // namespace unlidar
