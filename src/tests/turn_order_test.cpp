#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "base/angles.hpp"
#include "base/pose_history.hpp"
#include "io/point_times.hpp"

namespace unlidar {
namespace {

struct Scan {
  std::vector<Eigen::Vector3f> points_m;
  std::vector<double> shares;  // of the frame, true ones

  // Shares of the frame that are told by the order; none if nothing is.
  std::vector<double> Found(const SensorConfig& sensor = {}) const {
    constexpr TimeNs kBeginNs = 7'000'000'000;
    constexpr TimeNs kLengthNs = 100'000'000;
    std::vector<TimeNs> times_ns = {kBeginNs};  // of an earlier frame
    if (!SetTimesOfTurn(points_m, sensor, kBeginNs, kBeginNs + kLengthNs, &times_ns)) return {};
    std::vector<double> found;
    for (const TimeNs time_ns : times_ns) {
      found.push_back(static_cast<double>(time_ns - kBeginNs) / static_cast<double>(kLengthNs));
    }
    return found;
  }
};

Eigen::Vector3f At(double azimuth_rad, double elevation_rad, double range_m) {
  return Eigen::Vector3d(range_m * std::cos(azimuth_rad) * std::cos(elevation_rad),
                         range_m * std::sin(azimuth_rad) * std::cos(elevation_rad),
                         range_m * std::sin(elevation_rad))
      .cast<float>();
}

// Shots of 16 beams that point up to 3 degrees ahead and behind, of which some return nothing.
Scan Turn(double from_rad, double turn_rad, double least_share) {
  constexpr int kShots = 900;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform;
  Scan scan;
  for (int shot = 0; shot < kShots; ++shot) {
    const double share = static_cast<double>(shot) / kShots;
    // Half of the way around the sky is empty.
    const double returned = share > 0.3 && share < 0.8 ? least_share : 1.0;
    for (int beam = 0; beam < 16; ++beam) {
      const double ahead_rad = (beam % 4 - 1.5) * 2.0 * kRadPerDeg;
      const double range_m = uniform(random) < returned ? 5.0 + 40.0 * uniform(random) : 0.0;
      if (range_m == 0.0) continue;
      scan.points_m.push_back(
          At(from_rad + share * turn_rad + ahead_rad, (beam - 8) * 0.03, range_m));
      scan.shares.push_back(share);
    }
  }
  return scan;
}

TEST(TurnOrder, TellsTheTimesOfALidarThatTurnsEitherWayFromAnywhere) {
  for (const double turn_rad : {2.0 * M_PI, -2.0 * M_PI, 2.0 * M_PI + 0.05, 2.0 * M_PI - 0.05}) {
    for (const double from_rad : {-3.0, 0.0, 1.5, 3.1}) {
      for (const double least_share : {1.0, 0.2, 0.02}) {
        const Scan scan = Turn(from_rad, turn_rad, least_share);
        const std::vector<double> found = scan.Found();
        ASSERT_EQ(found.size(), scan.shares.size()) << turn_rad << ' ' << from_rad;
        double mean = 0.0;
        for (std::size_t i = 0; i < found.size(); ++i) {
          // Beams of one shot are up to 3 degrees, 0.8 % of a turn, ahead; so may be the ends.
          EXPECT_NEAR(found[i], scan.shares[i], 0.018);
          mean += (found[i] - scan.shares[i]) / static_cast<double>(found.size());
        }
        EXPECT_NEAR(mean, 0.0, 0.009);
      }
    }
  }
}

TEST(TurnOrder, IsThatAboutTheAxisOfTheSensorHoweverItIsMounted) {
  SensorConfig sensor;
  sensor.rotation_xyzw = {0.5, 0.5, 0.5, 0.5};
  sensor.translation_m = {3.0, -20.0, 1.5};
  const Scan level = Turn(1.5, -2.0 * M_PI, 0.2);
  Scan mounted;
  for (const Eigen::Vector3f& point_m : level.points_m) {
    const Eigen::Vector3d turned_m = RotationOf(sensor.rotation_xyzw) * point_m.cast<double>();
    mounted.points_m.push_back((turned_m + sensor.translation_m).cast<float>());
  }
  const std::vector<double> expected = level.Found();
  const std::vector<double> found = mounted.Found(sensor);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 2e-5);
}

TEST(TurnOrder, OfOtherScansTellsNothing) {
  using Azimuth = std::function<double(double)>;  // in rad, of the share of the frame
  const std::pair<std::string, Azimuth> azimuths[] = {
      {"half a turn", [](double share) { return share * M_PI; }},
      {"a turn and a half", [](double share) { return share * 3.0 * M_PI; }},
      {"ring by ring", [](double share) { return share * 16.0 * 2.0 * M_PI; }},
      {"a rosette", [](double share) { return 0.6 * std::sin(share * 77.0); }},
      {"lines of a raster", [](double share) { return std::fmod(share * 48.0, 1.0); }},
      {"there and back", [](double share) { return 2.0 * M_PI * (1.0 - std::abs(1 - 2 * share)); }},
      {"a turn with a piece of it at another place",
       [](double share) {
         return 2.0 * M_PI * (share > 0.4 && share < 0.6 ? share - 0.2 : share);
       }},
  };
  for (const auto& [name, azimuth_rad] : azimuths) {
    Scan scan;
    for (int i = 0; i < 12'000; ++i) {
      scan.points_m.push_back(At(azimuth_rad(i / 12'000.0), 0.1, 20.0));
    }
    EXPECT_TRUE(scan.Found().empty()) << name;
  }
  Scan scan = Turn(0.0, 2.0 * M_PI, 1.0);
  std::shuffle(scan.points_m.begin(), scan.points_m.end(), std::mt19937(1));
  EXPECT_TRUE(scan.Found().empty()) << "no order";
  EXPECT_TRUE(Scan().Found().empty());
}

}  // namespace
}  // namespace unlidar
