#include "trajectory/kind.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "tests/fit_trajectory.hpp"

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
  for (auto& column : trajectory.covariance_m2) column *= times * times;
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

// A multicopter that weaves about its course as its tilt allows, at a held height.
Path Weaving(double forward_mps, double tilt_rad, double period_s) {
  const double omega = 2.0 * M_PI / period_s;
  const double swing_m = 9.81 * std::tan(tilt_rad) / (omega * omega);
  return [=](double t) {
    return Eigen::Vector3d(forward_mps * t, swing_m * std::sin(omega * t),
                           15.0 + 0.1 * std::sin(0.7 * t));
  };
}

// A gull that circles in a thermal while the wind takes it along.
Path Soaring(double wind_mps) {
  return [=](double t) {
    return Eigen::Vector3d(18.0 * std::cos(0.55 * t) + wind_mps * t, 18.0 * std::sin(0.55 * t),
                           30.0 + 0.9 * t + 1.5 * std::sin(0.55 * t));
  };
}

// Between A and B with pauses, as limits of speed and acceleration allow.
Eigen::Vector3d Shuttle(double t) {
  constexpr double kPeriodS = 8.0;
  const double phase = std::fmod(t, kPeriodS) / kPeriodS;
  const double u = std::clamp(phase < 0.5 ? 4.0 * phase : 4.0 * (1.0 - phase), 0.0, 1.0);
  return {15.0 * u * u * (3.0 - 2.0 * u), 4.0, 12.0};
}

TEST(Kind, WhatHoversIsADrone) {
  const FlightStatistics character = Judge(Hover, 20.0);
  EXPECT_GT(character.kind.drone, 0.8);
  EXPECT_EQ(character.hover_share, 1.0);
  EXPECT_LT(character.wander_m, 0.3);
  EXPECT_GT(character.log_ratios[0], 0.0);
}

TEST(Kind, WhatRisesUprightIsADrone) {
  EXPECT_GT(Judge([](double t) { return Eigen::Vector3d(1.0, 2.0, 3.0 * t); }, 10.0).kind.drone,
            0.7);
}

TEST(Kind, WhatStandsAndFliesOffIsADrone) { EXPECT_GT(Judge(StopAndGo, 12.0).kind.drone, 0.6); }

TEST(Kind, WhatStopsInTheAirAndTurnsBackIsADrone) {
  EXPECT_GT(Judge(Shuttle, 24.0).kind.drone, 0.7);
}

TEST(Kind, AMulticopterThatWeavesAsFastAsItCanIsNoBird) {
  for (const double forward_mps : {5.0, 8.0, 11.0, 14.0}) {
    for (const double tilt_rad : {0.2, 0.4, 0.6}) {
      for (const double period_s : {3.0, 6.0}) {
        for (const double duration_s : {6.0, 20.0}) {
          const Kind kind = Judge(Weaving(forward_mps, tilt_rad, period_s), duration_s, 0.2).kind;
          EXPECT_LT(kind.bird_like, 0.5) << forward_mps << " m/s, " << tilt_rad << " rad, every "
                                         << period_s << " s, for " << duration_s << " s";
        }
      }
    }
  }
}

TEST(Kind, AConstantVelocityIsNeverSurelyADroneNorABird) {
  for (const double speed_mps : {5.0, 8.0, 12.0, 18.0, 25.0}) {
    for (const double duration_s : {5.0, 10.0, 30.0, 120.0}) {
      const Kind kind =
          Judge([=](double t) { return Eigen::Vector3d(speed_mps * t, 3.0, 30.0); }, duration_s)
              .kind;
      EXPECT_LT(kind.drone, 0.75) << speed_mps << " m/s for " << duration_s << " s";
      EXPECT_LT(kind.bird_like, 0.6) << speed_mps << " m/s for " << duration_s << " s";
    }
  }
  EXPECT_NEAR(Judge(Straight12, 10.0).straightness, 1.0, 1e-3);
}

TEST(Kind, WhatSoarsIsRatherABird) {
  for (const double wind_mps : {0.0, 3.0, 6.0}) {
    const Kind kind = Judge(Soaring(wind_mps), 20.0).kind;
    EXPECT_GT(kind.bird_like, kind.drone) << wind_mps << " m/s of wind";
    EXPECT_LT(kind.drone, 0.25);
  }
  EXPECT_GT(Judge(Circling, 20.0).kind.bird_like, Judge(Circling, 20.0).kind.drone);
}

// All styles occur in both classes.
TEST(Kind, TheProbabilityIsBoundedHoweverLongItIsSeen) {
  for (const Path& path : {Path(Hover), Path(Straight12), Path(Circling), Path(Shuttle),
                           Weaving(14.0, 0.6, 5.0), Soaring(4.0)}) {
    for (const double duration_s : {20.0, 300.0}) {
      const Kind kind = Judge(path, duration_s, 0.02).kind;
      EXPECT_LT(kind.drone, 0.98);
      EXPECT_LT(kind.bird_like, 0.7);
      EXPECT_GT(kind.unknown, 0.01);
    }
  }
}

TEST(Kind, FlownBackwardsItIsTheSame) {
  for (const Path& path : {Path(Hover), Path(Circling), Path(StopAndGo), Soaring(4.0)}) {
    std::vector<Measurement> measurements = Measure(path, 12.0, 0.05);
    const Kind forwards = Judge(FitTrajectory(measurements, {})).kind;
    std::vector<Measurement> reversed(measurements.rbegin(), measurements.rend());
    for (std::size_t i = 0; i < reversed.size(); ++i) {
      reversed[i].time_ns = measurements[i].time_ns;
    }
    ExpectNear(Judge(FitTrajectory(reversed, {})).kind, forwards, 5e-3);
  }
}

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

// Roughly: one cue fades before the other, so that what they say may add up to more on the way.
TEST(Kind, TheLessIsKnownTheNearerToThePrior) {
  for (const Path& path : {Path(Hover), Path(Straight12), Path(Circling), Path(StopAndGo)}) {
    const Trajectory trajectory = FitTrajectory(Measure(path, 4.0, 0.05), {});
    Kind before = Judge(trajectory).kind;
    for (const double times : {30.0, 100.0, 300.0, 1'000.0, 10'000.0}) {
      const Kind kind = Judge(LessSure(trajectory, times)).kind;
      EXPECT_GE(kind.unknown, before.unknown - 0.1) << times;
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
