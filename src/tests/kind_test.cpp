#include "trajectory/kind.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <vector>

namespace unlidar {
namespace {

using Path = std::function<Eigen::Vector3d(double)>;

constexpr TimeNs kBeginNs = 1'706'255'054'000'000'001;

// Ten measurements a second; normal noise of sigma_m, which they state.
std::vector<Measurement> Measure(const Path& path, double duration_s, double sigma_m,
                                 TimeNs begin_ns = kBeginNs, unsigned seed = 1) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal(0.0, 1.0);
  std::vector<Measurement> measurements;
  for (int i = 0; i <= static_cast<int>(duration_s * 10.0); ++i) {
    Measurement m;
    m.time_ns = begin_ns + i * TimeNs{100'000'000};
    const Eigen::Vector3d noise(normal(generator), normal(generator), normal(generator));
    m.position_m = path(0.1 * i) + sigma_m * noise;
    m.covariance_m2 *= sigma_m * sigma_m;
    measurements.push_back(m);
  }
  return measurements;
}

FlightStatistics Judge(const Trajectory& trajectory) {
  KindFilter filter;
  filter.Observe(trajectory, trajectory.end_ns());
  return filter.Describe();
}

FlightStatistics Judge(const Path& path, double duration_s, double sigma_m = 0.05) {
  return Judge(FitTrajectory(Measure(path, duration_s, sigma_m), {}));
}

Eigen::Vector3d Hover(double t) {
  return {0.2 * std::sin(0.5 * t), 0.2 * std::sin(0.33 * t), 10.0 + 0.1 * std::sin(0.4 * t)};
}
Eigen::Vector3d Straight12(double t) { return {12.0 * t, 0.0, 30.0}; }
Eigen::Vector3d StopAndGo(double t) {
  return {4.0 * std::max(0.0, t - 6.0) + 5.0, -3.0, 12.0 + std::min(t, 6.0)};
}
// Birds that circle while they climb.
Eigen::Vector3d Circling(double t) {
  return {40.0 * std::cos(0.25 * t), 40.0 * std::sin(0.25 * t), 30.0 + 0.8 * t};
}

// A trajectory with other sigmas.
Trajectory LessSure(Trajectory trajectory, double times) {
  for (auto& row : trajectory.covariances_m2) {
    for (Eigen::Matrix3d& block : row) block *= times * times;
  }
  return trajectory;
}

double DistanceFromPrior(const Kind& kind) {
  return std::abs(kind.drone - kPriorKind.drone) + std::abs(kind.bird_like - kPriorKind.bird_like) +
         std::abs(kind.unknown - kPriorKind.unknown);
}

void ExpectNear(const Kind& a, const Kind& b, double tolerance) {
  EXPECT_NEAR(a.drone, b.drone, tolerance);
  EXPECT_NEAR(a.bird_like, b.bird_like, tolerance);
  EXPECT_NEAR(a.unknown, b.unknown, tolerance);
}

TEST(Kind, WhatHoversIsADrone) {
  const FlightStatistics character = Judge(Hover, 10.0);
  EXPECT_GT(character.kind.drone, 0.95);
  EXPECT_EQ(character.hover_share, 1.0);
  EXPECT_LT(character.wander_m, 0.3);
  EXPECT_GT(character.log_ratios[0], 0.0);
}

TEST(Kind, WhatRisesUprightIsADrone) {
  EXPECT_GT(Judge([](double t) { return Eigen::Vector3d(1.0, 2.0, 3.0 * t); }, 10.0).kind.drone,
            0.95);
}

TEST(Kind, WhatStandsAndFliesOffIsADrone) { EXPECT_GT(Judge(StopAndGo, 12.0).kind.drone, 0.95); }

TEST(Kind, SteadyFlightAtTheSpeedOfBirdsIsNeverSurelyADrone) {
  for (const double duration_s : {5.0, 10.0, 30.0}) {
    const Kind kind = Judge(Straight12, duration_s).kind;
    EXPECT_LT(kind.drone, 0.5) << duration_s << " s";
    // Nor surely a bird: a drone on a mission flies like this, too.
    EXPECT_LT(kind.bird_like, 0.99) << duration_s << " s";
  }
  EXPECT_NEAR(Judge(Straight12, 10.0).straightness, 1.0, 1e-3);
}

TEST(Kind, WhatCirclesFastIsBirdLike) { EXPECT_GT(Judge(Circling, 20.0).kind.bird_like, 0.5); }

TEST(Kind, NothingSeenIsThePrior) {
  ExpectNear(KindFilter().kind(), kPriorKind, 1e-12);
  ExpectNear(Judge(Hover, 0.5).kind, kPriorKind, 1e-12);
}

TEST(Kind, AShortNoisyTrackIsUnknown) {
  for (const Path& path : {Path(Hover), Path(Straight12), Path(Circling), Path(StopAndGo)}) {
    const Kind kind = Judge(LessSure(FitTrajectory(Measure(path, 1.5, 0.3), {}), 40.0)).kind;
    EXPECT_GT(kind.unknown, kind.drone);
    EXPECT_GT(kind.unknown, kind.bird_like);
  }
}

TEST(Kind, ProbabilitiesAddUpToOne) {
  for (const Path& path : {Path(Hover), Path(Straight12), Path(Circling), Path(StopAndGo)}) {
    for (const double duration_s : {1.2, 2.5, 7.0}) {
      const Kind kind = Judge(path, duration_s).kind;
      EXPECT_NEAR(kind.drone + kind.bird_like + kind.unknown, 1.0, 1e-12);
      for (const double p : {kind.drone, kind.bird_like, kind.unknown}) {
        EXPECT_GE(p, 0.0);
        EXPECT_NEAR(p * 1e4, std::round(p * 1e4), 1e-8);
      }
    }
  }
}

// The fit is made at the moved place, too, so digits may differ.
TEST(Kind, PlaceHeadingAndTimeSayNothing) {
  const double angle_rad = 1.1;
  Eigen::Matrix3d rotation;
  rotation << std::cos(angle_rad), -std::sin(angle_rad), 0.0, std::sin(angle_rad),
      std::cos(angle_rad), 0.0, 0.0, 0.0, 1.0;
  for (const Path& path : {Path(Hover), Path(Circling), Path(StopAndGo)}) {
    const std::vector<Measurement> measurements = Measure(path, 4.0, 0.1);
    std::vector<Measurement> moved = measurements;
    for (Measurement& m : moved) {
      m.position_m = rotation * m.position_m + Eigen::Vector3d(300.0, -200.0, 50.0);
      m.covariance_m2 = rotation * m.covariance_m2 * rotation.transpose();
      m.time_ns += 86'400'000'000'000;
    }
    ExpectNear(Judge(FitTrajectory(moved, {})).kind, Judge(FitTrajectory(measurements, {})).kind,
               2e-3);
  }
}

TEST(Kind, MirroredFlightIsTheSame) {
  const Path mirrored = [](double t) {
    const Eigen::Vector3d p = Circling(t);
    return Eigen::Vector3d(p.x(), -p.y(), p.z());
  };
  // Without noise, which is not mirrored.
  const auto judge = [](const Path& path) {
    std::vector<Measurement> measurements = Measure(path, 8.0, 0.1);
    for (std::size_t i = 0; i < measurements.size(); ++i) {
      measurements[i].position_m = path(0.1 * static_cast<double>(i));
    }
    return Judge(FitTrajectory(measurements, {})).kind;
  };
  ExpectNear(judge(mirrored), judge(Circling), 2e-3);
}

// Which of drone and bird-like is ahead may change on the way: one cue fades before the other.
TEST(Kind, TheLessIsKnownTheNearerToThePrior) {
  for (const Path& path : {Path(Hover), Path(Straight12), Path(Circling), Path(StopAndGo)}) {
    const Trajectory trajectory = FitTrajectory(Measure(path, 4.0, 0.05), {});
    Kind before = Judge(trajectory).kind;
    for (const double times : {30.0, 100.0, 300.0, 1'000.0, 10'000.0}) {
      const Kind kind = Judge(LessSure(trajectory, times)).kind;
      EXPECT_GE(kind.unknown, before.unknown - 0.01) << times;
      before = kind;
    }
    EXPECT_LT(DistanceFromPrior(before), 0.02);
  }
}

// As the sigmas of a gap say: who knows what it did there.
TEST(Kind, AGapSaysLittle) {
  std::vector<Measurement> measurements = Measure(Hover, 12.0, 0.05);
  measurements.erase(measurements.begin() + 11, measurements.end() - 11);
  const FlightStatistics gap = Judge(FitTrajectory(measurements, {}));
  EXPECT_EQ(gap.seconds, 12.0);
  EXPECT_LT(gap.kind.drone, Judge(Hover, 12.0).kind.drone);
}

// A stream fits anew again and again and judges each second once.
TEST(Kind, SecondBySecondIsAsAllAtOnce) {
  const Trajectory trajectory = FitTrajectory(Measure(StopAndGo, 12.0, 0.05), {});
  KindFilter filter;
  for (TimeNs at_ns = trajectory.begin_ns(); at_ns < trajectory.end_ns(); at_ns += 70'000'000) {
    filter.Observe(trajectory, at_ns);
  }
  filter.Observe(trajectory, trajectory.end_ns());
  const FlightStatistics all = Judge(trajectory);
  EXPECT_EQ(filter.Describe().seconds, 12.0);
  EXPECT_EQ(filter.kind().drone, all.kind.drone);
  EXPECT_EQ(filter.Describe().log_ratios, all.log_ratios);
}

TEST(Kind, AbsurdSpeedsAreNoFault) {
  for (const double speed_mps : {0.0, 39.0, 80.0, 1e4, 1e7}) {
    Trajectory trajectory = FitTrajectory(Measure(Hover, 5.0, 0.05), {});
    for (std::size_t i = 0; i < trajectory.control_points_m.size(); ++i) {
      trajectory.control_points_m[i] *= speed_mps;
    }
    const FlightStatistics character = Judge(LessSure(trajectory, 1e-6));
    EXPECT_NEAR(character.kind.drone + character.kind.bird_like + character.kind.unknown, 1.0,
                1e-9);
    for (const double log_ratio : character.log_ratios) EXPECT_TRUE(std::isfinite(log_ratio));
  }
}

}  // namespace
}  // namespace unlidar
