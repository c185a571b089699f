#include "scene/sway.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace unlidar {
namespace {

constexpr double kRadPerDeg = M_PI / 180.0;
constexpr double kFrameS = 0.1;

// Rotation vector of a mast that sways by `deg` at 0.4 Hz about a horizontal axis.
Eigen::Vector3d SwayRad(double deg, double time_s) {
  return deg * kRadPerDeg * std::sin(2.0 * M_PI * 0.4 * time_s) * Eigen::Vector3d(0.8, 0.6, 0.0);
}

struct Scan {
  FrameInfo info;
  std::vector<Eigen::Vector3f> points_m;
  std::vector<Eigen::Vector3f> true_m;  // at rest
  std::vector<TimeNs> times_ns;

  SwayingFrame View() {
    return {&info, points_m.data(), points_m.size(), [this](std::size_t i) { return times_ns[i]; }};
  }
};

// What returns are of, seen from a sensor 3 m up, with 2 cm of noise.
enum class Place {
  kYard,     // of 24 by 20 m, with walls
  kNothing,  // returns fill the air
  kGround,   // and a few trees of 1 m, of which each frame sees what is at one depression
};

Scan ScanAt(int number, double deg, Place place, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::normal_distribution<double> noise(0.0, 0.02);
  Scan scan;
  scan.info.begin_ns = NsOf(number * kFrameS);
  scan.info.end_ns = NsOf((number + 1) * kFrameS);
  scan.info.stamp_ns = scan.info.begin_ns;
  for (int i = 0; i < 3000; ++i) {
    const double x = 12.0 * uniform(*random);
    const double y = 10.0 * uniform(*random);
    const double z = 4.0 * uniform(*random) + 1.0;
    Eigen::Vector3d point_m(x, y, z);
    if (place == Place::kYard) {
      if (i % 3 == 0) point_m.z() = -3.0;
      if (i % 3 == 1) point_m.x() = std::copysign(12.0, x);
      if (i % 3 == 2) point_m.y() = std::copysign(10.0, y);
    }
    if (place == Place::kGround) {
      const double phase = M_PI * (0.5 + 0.5 * uniform(*random) + number) / 7.0;
      const double range_m = 17.0 + 7.0 * std::sin(phase);
      const double azimuth_rad = M_PI * uniform(*random);
      point_m = {range_m * std::cos(azimuth_rad), range_m * std::sin(azimuth_rad), -3.0};
      if (i % 4 == 0) {
        const double side_rad = 0.7 * static_cast<double>(i / 4 % 9);
        const double height_m = 2.0 * std::sin(phase) + 0.5 * uniform(*random);
        point_m = Eigen::AngleAxisd(side_rad, Eigen::Vector3d::UnitZ()) *
                  Eigen::Vector3d(14.0 - std::cos(z), std::sin(z), height_m);
      }
    }
    point_m += Eigen::Vector3d(noise(*random), noise(*random), noise(*random));
    const double time_s = (number + i / 3000.0) * kFrameS;
    const Eigen::Vector3d turn_rad = SwayRad(deg, time_s);
    const double angle_rad = turn_rad.norm();
    const Eigen::Vector3d seen_m =
        angle_rad > 0.0
            ? Eigen::Vector3d(Eigen::AngleAxisd(-angle_rad, turn_rad / angle_rad) * point_m)
            : point_m;
    scan.points_m.push_back(seen_m.cast<float>());
    scan.true_m.push_back(point_m.cast<float>());
    scan.times_ns.push_back(NsOf(time_s));
  }
  return scan;
}

double ErrorM(const std::vector<Scan>& scans) {
  double sum_m2 = 0.0;
  std::size_t count = 0;
  for (const Scan& scan : scans) {
    for (std::size_t i = 0; i < scan.points_m.size(); ++i, ++count) {
      sum_m2 += (scan.points_m[i] - scan.true_m[i]).squaredNorm();
    }
  }
  return std::sqrt(sum_m2 / static_cast<double>(count));
}

struct Result {
  double error_m = 0.0;  // to where returns are at rest
  double largest_deg = 0.0;
};

// Of the last second of 12 s of a stream.
Result ResultOfStream(double deg, Place place, unsigned seed) {
  std::mt19937 random(seed);
  Sway sway;
  std::vector<Scan> last;
  for (int number = 0; number < 120; ++number) {
    Scan scan = ScanAt(number, deg, place, &random);
    const SwayingFrame frame = scan.View();
    sway.Correct(sway.Observe(SensorInfo(), frame), frame);
    if (number >= 110) last.push_back(std::move(scan));
  }
  EXPECT_EQ(sway.WarningOf(0, "a").has_value(), sway.LargestDeg(0) > 0.0);
  return {ErrorM(last), sway.LargestDeg(0)};
}

TEST(Sway, IsRemovedFromReturnsWhereWallsStand) {
  for (const double deg : {0.3, 0.7, 1.0}) {
    const Result result = ResultOfStream(deg, Place::kYard, 1);
    EXPECT_LT(result.error_m, 0.02) << deg;  // 0.06 to 0.15 m without
    EXPECT_NEAR(result.largest_deg, deg, 0.3 * deg + 0.05);
  }
}

TEST(Sway, OfARecordingIsRemovedFromItsFirstFramesToo) {
  std::mt19937 random(1);
  Sway sway;
  std::vector<Scan> scans;
  std::vector<SwayEstimate> estimates;
  for (int number = 0; number < 120; ++number) {
    scans.push_back(ScanAt(number, 0.7, Place::kYard, &random));
    estimates.push_back(sway.Observe(SensorInfo(), scans.back().View()));
  }
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const SwayingFrame frame = scans[i].View();
    sway.Correct(sway.Refine(estimates[i], frame), frame);
  }
  scans.resize(10);
  EXPECT_LT(ErrorM(scans), 0.02);
}

TEST(Sway, OfASensorAtRestLeavesEachReturnAsItIs) {
  for (const Place place : {Place::kYard, Place::kNothing, Place::kGround}) {
    for (const unsigned seed : {1U, 2U, 3U}) {
      const Result result = ResultOfStream(0.0, place, seed);
      EXPECT_EQ(result.error_m, 0.0);
      EXPECT_EQ(result.largest_deg, 0.0);
    }
  }
}

TEST(Sway, IsNotFollowedFarBeyondADegreeNorAmongStrays) {
  for (const auto& [deg, place] : {std::pair(8.0, Place::kYard), std::pair(1.0, Place::kNothing)}) {
    std::mt19937 random(1);
    Sway sway;
    for (int number = 0; number < 60; ++number) {
      Scan scan = ScanAt(number, deg, place, &random);
      const std::vector<Eigen::Vector3f> before_m = scan.points_m;
      const SwayingFrame frame = scan.View();
      sway.Correct(sway.Observe(SensorInfo(), frame), frame);
      EXPECT_EQ(scan.points_m, before_m) << deg << " " << number;
    }
    EXPECT_EQ(sway.LargestDeg(0), 0.0);
  }
}

TEST(Sway, IsWhatHalfOfTheDirectionsTellOfTheOthers) {
  for (const double deg : {0.0, 0.7}) {
    std::mt19937 random(1);
    SurfaceMap map;
    for (int number = 0; number < 10; ++number) {
      for (const Eigen::Vector3f& point_m : ScanAt(number, 0.0, Place::kYard, &random).true_m) {
        map.Add(point_m.cast<double>());
      }
    }
    const Eigen::AngleAxisd turn(deg * kRadPerDeg, Eigen::Vector3d::UnitX());
    std::vector<TimedReturn> returns;
    for (const Eigen::Vector3f& point_m : ScanAt(10, 0.0, Place::kYard, &random).true_m) {
      returns.push_back({turn * point_m.cast<double>(), 0});
    }
    SmallMotionFilter filter(0);
    const SmallMotionFilter::Fit fit = filter.Update(returns, map);
    const double explained = 1.0 - fit.held_out_error / fit.rest_error;
    if (deg > 0.0) {
      EXPECT_GT(explained, 0.3);
    } else {
      EXPECT_LT(explained, 0.01);
    }
  }
}

TEST(Sway, OfASensorWithPosesIsNotEstimated) {
  std::mt19937 random(1);
  Sway sway;
  SensorInfo sensor;
  sensor.carrier = &random;
  Scan scan = ScanAt(0, 1.0, Place::kYard, &random);
  EXPECT_EQ(sway.Observe(sensor, scan.View()).period, nullptr);
}

}  // namespace
}  // namespace unlidar
