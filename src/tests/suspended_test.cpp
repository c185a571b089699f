#include "collection/suspended.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "tests/synthetic_recording.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::Random;

constexpr int kDraws = 100;

// Seen in a third of the frames of a recording, at `at(time_s)` about `place_m`, by single returns.
Target SeenNow(const Eigen::Vector3d& place_m, double duration_s, Random* random,
               const std::function<Eigen::Vector3d(double time_s)>& at) {
  Target target;
  for (double time_s = 0.0; time_s < duration_s; time_s += 0.1) {
    if (random->Uniform(0.0, 1.0) > 0.33) continue;
    Measurement m;
    m.time_ns = kBeginNs + std::llround(time_s * 1e9);
    m.position_m = place_m + at(time_s) + random->NormalVector(0.1);
    target.measurements.push_back(m);
  }
  return target;
}

using MotionAt = std::function<Eigen::Vector3d(double time_s, double phase)>;
using Rule = std::function<bool(const std::vector<Measurement>&)>;

// Of many things that move about such a place, the share for which a rule holds.
double ShareOf(const Rule& rule, const Eigen::Vector3d& place_m, double duration_s,
               const MotionAt& at) {
  int num_held = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    Random random(static_cast<std::uint32_t>(draw + 1));
    const double phase = random.Uniform(0.0, 2.0 * M_PI);
    const Target target =
        SeenNow(place_m, duration_s, &random, [&](double time_s) { return at(time_s, phase); });
    num_held += rule(target.measurements) ? 1 : 0;
  }
  return static_cast<double>(num_held) / kDraws;
}

double ShareHanging(const Eigen::Vector3d& place_m, double duration_s, const MotionAt& at) {
  return ShareOf(MayBeSuspended, place_m, duration_s, at);
}

Eigen::Vector3d Still(double /*time_s*/, double /*phase*/) { return Eigen::Vector3d::Zero(); }

// As a position hold does: slowly, by a quarter of a metre.
Eigen::Vector3d Hover(double time_s, double phase) {
  return 0.25 * Eigen::Vector3d(std::sin(0.35 * time_s + phase), std::cos(0.22 * time_s + phase),
                                0.5 * std::sin(0.5 * time_s + phase));
}

const Eigen::Vector3d kFarM(24.0, -20.0, 5.0);

TEST(MayBeSuspended, WhatStandsStillFarAwayMay) {
  EXPECT_GE(ShareHanging(kFarM, 10.0, Still), 0.98);
  EXPECT_GE(ShareHanging(kFarM, 60.0, Still), 0.98);
}

TEST(MayBeSuspended, WhatSwingsMay) {
  const auto swing = [](double time_s, double phase) {
    return Eigen::Vector3d(0.1 * std::sin(2.0 * M_PI * 0.5 * time_s + phase), 0.0, 0.0);
  };
  EXPECT_GE(ShareHanging(kFarM, 20.0, swing), 0.95);
}

TEST(MayBeSuspended, WhatWandersHovers) {
  EXPECT_LE(ShareHanging(kFarM, 20.0, Hover), 0.02);
  EXPECT_LE(ShareHanging(kFarM, 60.0, Hover), 0.0);
}

TEST(MayBeSuspended, WhatFliesDoesNot) {
  const auto flight = [](double time_s, double /*phase*/) {
    return Eigen::Vector3d(0.8 * time_s, 0.0, 0.0);
  };
  EXPECT_EQ(ShareHanging(kFarM, 5.0, flight), 0.0);
}

TEST(MayBeSuspended, ACableThatIsNearWouldBeSeen) {
  EXPECT_EQ(ShareHanging({12.0, -9.0, 5.0}, 10.0, Still), 0.0);
}

TEST(MayBeSuspended, SightingsOfOneInstantTellNothingOfMotion) {
  Target target;
  target.measurements.resize(2);
  for (Measurement& m : target.measurements) m.position_m = kFarM;
  EXPECT_TRUE(MayBeSuspended(target.measurements));
}

// The share that ever seems to go straight on, looked at again and again.
double ShareGoingOn(double duration_s, const MotionAt& at) {
  const auto ever_goes_on = [](const std::vector<Measurement>& measurements) {
    std::vector<Measurement> until_now;
    return std::any_of(measurements.begin(), measurements.end(), [&](const Measurement& m) {
      until_now.push_back(m);
      return MovesStraight(until_now);
    });
  };
  return ShareOf(ever_goes_on, kFarM, duration_s, at);
}

TEST(MovesStraight, WhatFliesSlowlyDoes) {
  const auto slowly = [](double time_s, double phase) {
    return Eigen::Vector3d(0.3 * time_s * std::cos(phase), 0.3 * time_s * std::sin(phase), 0.0);
  };
  EXPECT_GE(ShareGoingOn(5.0, slowly), 0.98);
  EXPECT_EQ(ShareGoingOn(2.9, slowly), 0.0);
}

TEST(MovesStraight, WhatStandsStillOrSwingsDoesNot) {
  EXPECT_EQ(ShareGoingOn(10.0, Still), 0.0);
  for (const double reach_m : {0.1, 0.3, 0.6}) {
    const auto swing = [&](double time_s, double phase) {
      const double hz = 0.25 + 0.05 * phase;
      return Eigen::Vector3d(reach_m * std::sin(2.0 * M_PI * hz * time_s + phase),
                             reach_m * std::sin(2.0 * M_PI * 0.4 * time_s + 3.0 * phase), 0.0);
    };
    EXPECT_LE(ShareGoingOn(10.0, swing), 0.05) << reach_m;
  }
}

}  // namespace
}  // namespace unlidar
