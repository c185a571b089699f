#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "collection/dwells.hpp"
#include "tests/draws.hpp"
#include "tests/fit_trajectory.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::Random;

// The definition: step by step along the trajectory.
std::pair<TimeNs, TimeNs> Walk(const Trajectory& trajectory, TimeNs time_ns,
                               const Eigen::Vector3d& place_m, double reach_m) {
  constexpr TimeNs kStepNs = 250'000'000;
  const auto is_near = [&](TimeNs at_ns) {
    return (trajectory.At(at_ns).position_m - place_m).norm() < reach_m;
  };
  TimeNs from = time_ns;
  while (from > trajectory.begin_ns() && is_near(from - kStepNs)) from -= kStepNs;
  TimeNs to = time_ns;
  while (to < trajectory.end_ns() && is_near(to + kStepNs)) to += kStepNs;
  return {from, to};
}

Trajectory Fit(const std::vector<double>& times_s,
               const std::function<Eigen::Vector3d(double)>& position_m, Random* random,
               const TrajectoryConfig& config = {}) {
  std::vector<Measurement> measurements;
  for (const double time_s : times_s) {
    Measurement m;
    m.time_ns = kBeginNs + std::llround(time_s * 1e9);
    m.position_m = position_m(time_s) + random->NormalVector(0.05);
    m.covariance_m2 *= 0.05 * 0.05;
    measurements.push_back(m);
  }
  return FitTrajectory(measurements, config);
}

TEST(DwellIntervals, IsThatOfAWalkAlongTheTrajectory) {
  Random random(1);
  constexpr int kTrials = testing::Draws(60);
  int num_stays = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    // Flights that come back, stand still, or go on, with pauses.
    const double speed_mps = trial % 4 == 0 ? 0.0 : random.Uniform(0.1, 6.0);
    const double turn_hz = random.Uniform(0.01, 0.3);
    const auto position_m = [&](double time_s) {
      const double phase = 2.0 * M_PI * turn_hz * time_s;
      return Eigen::Vector3d(20.0 + speed_mps / turn_hz * 0.2 * std::sin(phase),
                             speed_mps * (trial % 3 == 0 ? time_s : std::cos(phase)), 12.0);
    };
    TrajectoryConfig config;
    if (trial % 5 == 0) config.max_extrapolation_s = 0.0;  // few intervals beyond the ends
    std::vector<double> times_s = {0.0};
    const std::uint32_t num_measurements = 1 + random.Index(120);
    while (times_s.size() < num_measurements) {
      times_s.push_back(times_s.back() + (random.Index(20) == 0 ? 4.0 : 0.1));
    }
    const Trajectory trajectory = Fit(times_s, position_m, &random, config);
    for (int query = 0; query < 60; ++query) {
      const double time_s = random.Uniform(-3.0, times_s.back() + 3.0);
      const TimeNs time_ns = kBeginNs + std::llround(time_s * 1e9);
      const double reach_m = std::exp(random.Uniform(-2.0, 4.0));
      const Eigen::Vector3d place_m =
          trajectory.At(time_ns).position_m + random.NormalVector(0.4 * reach_m);
      const auto expected = Walk(trajectory, time_ns, place_m, reach_m);
      ASSERT_EQ(DwellAround(trajectory, time_ns, place_m, reach_m), expected)
          << trial << ' ' << time_s;
      num_stays += expected.second - expected.first > 2'000'000'000 ? 1 : 0;
    }
  }
  EXPECT_GT(num_stays, 10 * kTrials);
}

// A drone that hovers for three hours: to walk would take minutes.
TEST(DwellIntervals, TakesLittleTimeHoweverLongTheStay) {
  constexpr double kMostCpuS = 20.0;  // enough under a sanitizer
  Random random(2);
  std::vector<double> times_s;
  for (int i = 0; i < testing::Draws(2'000); ++i) times_s.push_back(5.0 * i);
  const Trajectory trajectory = Fit(
      times_s, [](double t) { return Eigen::Vector3d(9.0, std::sin(t / 60.0), 9.0); }, &random);
  const std::clock_t begin = std::clock();
  for (int query = 0; query < testing::Draws(5'000); ++query) {
    const auto [from, to] = DwellAround(trajectory, kBeginNs + query * TimeNs{2'000'000'000},
                                        Eigen::Vector3d(9.0, 0.0, 9.0), 3.0);
    ASSERT_LE(from, trajectory.begin_ns());
    ASSERT_GE(to, trajectory.end_ns());
  }
  EXPECT_LT(static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC, kMostCpuS);
}

}  // namespace
}  // namespace unlidar
