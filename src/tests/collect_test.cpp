#include "collection/collect.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "collection/body.hpp"
#include "tests/learned_occupancy.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::LearnedOccupancy;
using testing::Random;
using testing::RecordingMaker;
using testing::SecondsSinceBegin;

constexpr int kWall = 1;
constexpr int kDrone = 2;
constexpr int kFrames = 100;

Eigen::Vector3d DroneAt(double time_s) {
  return {15.0 + std::sin(0.5 * time_s), 2.0 * time_s - 10.0, 8.0 + 0.2 * time_s};
}

// What a tracker would hand over: the returns of the drone in each frame from `first` to `last`
// in which there are any.
std::vector<Plot> PathOf(const RecordingMaker& maker, std::uint32_t first, std::uint32_t last) {
  std::vector<Plot> path;
  const Recording& recording = maker.recording;
  for (std::uint32_t f = first; f <= last; ++f) {
    Plot plot;
    plot.frame = f;
    const FrameInfo& frame = recording.frames[f];
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      if (maker.labels[i] == kDrone) plot.returns.push_back(i);
    }
    if (plot.returns.empty()) continue;
    for (const std::uint32_t i : plot.returns) {
      plot.position_m +=
          recording.points_m[i].cast<double>() / static_cast<double>(plot.returns.size());
    }
    plot.time_ns = recording.times_ns[plot.returns.front()];
    path.push_back(plot);
  }
  return path;
}

Target Collect(const RecordingMaker& maker, const std::vector<Plot>& path,
               std::vector<char> excluded = {}, const CollectConfig& config = CollectConfig(),
               const std::vector<Rule>& disabled_rules = {}) {
  excluded.resize(maker.labels.size(), 0);
  const LearnedOccupancy learned(maker.recording);
  const std::vector<StationModel> station_models(maker.recording.sensors.size(), learned.ModelAt());
  RobustConfig robust;
  robust.collect = config;
  robust.disabled_rules = disabled_rules;
  return CollectTarget(maker.recording, station_models, path, excluded, robust, TrajectoryConfig());
}

double ShareFound(const RecordingMaker& maker, const Target& target, int label) {
  double found = 0.0;
  for (const std::uint32_t i : target.returns) found += maker.labels[i] == label ? 1.0 : 0.0;
  return found / static_cast<double>(std::count(maker.labels.begin(), maker.labels.end(), label));
}

// Root mean square distance of the measurements from the drone's truth.
double RmseM(const Target& target) {
  double sum = 0.0;
  for (const Measurement& m : target.measurements) {
    sum += (m.position_m - DroneAt(SecondsSinceBegin(m.time_ns))).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(target.measurements.size()));
}

RecordingMaker Flight(std::uint32_t seed, double returns_per_frame) {
  RecordingMaker maker(seed);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddBlob(DroneAt(testing::MiddleS(i)), 0.1, maker.random.Poisson(returns_per_frame),
                  kDrone);
  }
  return maker;
}

TEST(CollectTarget, FindsTheReturnsThatThePathMissed) {
  const RecordingMaker maker = Flight(1, 4.0);
  std::vector<Plot> path = PathOf(maker, 0, kFrames - 1);
  for (std::size_t k = 0; k < path.size(); ++k)
    path[k].returns = {path[k].returns.front()};  // one each,
  for (std::size_t k = path.size(); k-- > 0;) {   // of every third frame
    if (k % 3 != 0) path.erase(path.begin() + static_cast<std::ptrdiff_t>(k));
  }
  const Target target = Collect(maker, path);
  EXPECT_GT(ShareFound(maker, target, kDrone), 0.97);
  EXPECT_LT(RmseM(target), 0.15);
}

TEST(CollectTarget, MeasurementsAreTheMeansOfTheReturnsOfAFrame) {
  const RecordingMaker maker = Flight(2, 4.0);
  const Recording& recording = maker.recording;
  CollectConfig raw;
  raw.centroid_offset = 0.0;
  const Target target = Collect(maker, PathOf(maker, 0, kFrames - 1), {}, raw);
  ASSERT_TRUE(std::is_sorted(target.returns.begin(), target.returns.end()));
  int support = 0;
  for (std::size_t k = 0; k < target.measurements.size(); ++k) {
    const Measurement& m = target.measurements[k];
    if (k > 0) {
      EXPECT_GT(m.time_ns, target.measurements[k - 1].time_ns);
    }
    Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
    int count = 0;
    for (const std::uint32_t i : target.returns) {
      if (std::abs(recording.times_ns[i] - m.time_ns) > kPeriodNs / 2) continue;
      sum_m += recording.points_m[i].cast<double>();
      ++count;
    }
    ASSERT_EQ(m.support, count);
    EXPECT_LT((m.position_m - sum_m / count).norm(), 1e-6);
    support += count;
  }
  EXPECT_EQ(static_cast<std::size_t>(support), target.returns.size());
}

TEST(CollectTarget, MoreReturnsGiveASmallerCovariance) {
  const RecordingMaker maker = Flight(3, 3.0);
  std::vector<double> least(20, 1e9);
  std::vector<double> most(20, 0.0);
  for (const Measurement& m : Collect(maker, PathOf(maker, 0, kFrames - 1)).measurements) {
    const auto n = static_cast<std::size_t>(m.support);
    // Upwards, where it hardly moves within a frame.
    least[n] = std::min(least[n], m.covariance_m2(2, 2));
    most[n] = std::max(most[n], m.covariance_m2(2, 2));
  }
  EXPECT_LT(most[4], least[2]);
  EXPECT_LT(most[2], least[1]);
}

TEST(CollectTarget, AConstantDisagreementOfTwoSensorsIsTakenOut) {
  const Eigen::Vector3d offset_m(0.25, -0.2, 0.15);
  RecordingMaker maker(4, 2);
  for (int i = 0; i < 2 * kFrames; ++i) {
    const auto sensor = static_cast<std::uint32_t>(i % 2);
    const double begin_s = 0.5 * i * kPeriodS;
    maker.BeginFrame(begin_s, sensor);
    Eigen::Vector3d at_m = DroneAt(begin_s + 0.5 * kPeriodS);
    if (sensor == 1) at_m += offset_m;
    maker.AddBlob(at_m, 0.1, 6, kDrone);
  }
  const Target target = Collect(maker, PathOf(maker, 0, 2 * kFrames - 1));
  EXPECT_GT(ShareFound(maker, target, kDrone), 0.97);
  EXPECT_LT(RmseM(target), 0.12);  // the noise of means of six returns is 0.07
  // Without it, each step from one sensor to the other would be as long as the disagreement.
  Eigen::Vector3d mean_step_m = Eigen::Vector3d::Zero();
  int num_steps = 0;
  for (std::size_t k = 1; k < target.measurements.size(); ++k) {
    const auto error_at = [&](std::size_t j) -> Eigen::Vector3d {
      const Measurement& m = target.measurements[j];
      return m.position_m - DroneAt(SecondsSinceBegin(m.time_ns));
    };
    // Even measurements come from the first sensor as long as none is missing.
    mean_step_m += (k % 2 == 1 ? 1.0 : -1.0) * (error_at(k) - error_at(k - 1));
    ++num_steps;
  }
  ASSERT_EQ(target.measurements.size(), 2U * kFrames);
  EXPECT_LT((mean_step_m / num_steps).norm(), 0.04);
}

TEST(CollectTarget, ADelayOfASensorsClockIsTakenOut) {
  constexpr double kDelayS = 0.06;
  const auto at = [](double time_s) -> Eigen::Vector3d {  // a circle, at 6 m/s
    return {15.0 + 4.0 * std::cos(1.5 * time_s), 4.0 * std::sin(1.5 * time_s), 8.0};
  };
  RecordingMaker maker(12, 2);
  for (int i = 0; i < 2 * kFrames; ++i) {
    const auto sensor = static_cast<std::uint32_t>(i % 2);
    const double begin_s = 0.5 * i * kPeriodS;
    maker.BeginFrame(begin_s, sensor);
    maker.AddBlob(at(begin_s + 0.5 * kPeriodS - (sensor == 1 ? kDelayS : 0.0)), 0.1, 6, kDrone);
  }
  const auto rmse_m = [&](const CollectConfig& config) {
    const Target target = Collect(maker, PathOf(maker, 0, 2 * kFrames - 1), {}, config);
    EXPECT_GT(ShareFound(maker, target, kDrone), 0.97);
    double sum_m2 = 0.0;
    for (const Measurement& m : target.measurements) {
      sum_m2 += (m.position_m - at(SecondsSinceBegin(m.time_ns))).squaredNorm();
    }
    return std::sqrt(sum_m2 / static_cast<double>(target.measurements.size()));
  };
  CollectConfig without;
  without.sensor_delay_s = 1e-6;
  EXPECT_LT(rmse_m(CollectConfig()), 0.12);  // the noise of means of six returns is 0.07
  EXPECT_GT(rmse_m(without), 0.2);           // 0.36 m at every second measurement
}

// One sensor sees the first half of the flight, the other one the second; where they meet there is
// one comparison of the two, and it is with a stray.
TEST(CollectTarget, AStrayThatIsAllThatComparesTwoSensorsShiftsNeither) {
  RecordingMaker maker(14, 2);
  constexpr int kMeeting = kFrames / 2;
  for (int i = 0; i < kFrames; ++i) {
    for (std::uint32_t sensor = 0; sensor < 2; ++sensor) {
      const double begin_s = i * kPeriodS + 0.01 * sensor;
      maker.BeginFrame(begin_s, sensor);
      const Eigen::Vector3d at_m = DroneAt(begin_s + 0.5 * kPeriodS);
      if (sensor == 0 && i < kMeeting) maker.AddBlob(at_m, 0.1, 8, kDrone);
      if (sensor == 1 && i > kMeeting + 3) maker.AddBlob(at_m, 0.1, 6, kDrone);
      if (sensor == 1 && i == kMeeting - 2) {
        maker.AddBlob(at_m + Eigen::Vector3d(0.0, 0.5, 0.0), 0.01, 1, kDrone);
      }
    }
  }
  const Target target = Collect(maker, PathOf(maker, 0, 2 * kFrames - 1));
  Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
  double count = 0.0;
  for (const Measurement& m : target.measurements) {
    if (SecondsSinceBegin(m.time_ns) < (kMeeting + 1) * kPeriodS) continue;
    sum_m += m.position_m - DroneAt(SecondsSinceBegin(m.time_ns));
    ++count;
  }
  ASSERT_GT(count, 30.0);
  EXPECT_LT((sum_m / count).norm(), 0.08);
}

TEST(CollectTarget, TheCentreLiesBehindTheReturnsByAShareOfTheirSpread) {
  const RecordingMaker maker = Flight(13, 6.0);
  const std::vector<Plot> path = PathOf(maker, 0, kFrames - 1);
  CollectConfig raw;
  raw.centroid_offset = 0.0;
  const Target corrected = Collect(maker, path);
  const Target means = Collect(maker, path, {}, raw);
  ASSERT_EQ(corrected.measurements.size(), means.measurements.size());
  for (std::size_t k = 0; k < means.measurements.size(); ++k) {
    const Eigen::Vector3d& mean_m = means.measurements[k].position_m;
    const Eigen::Vector3d shift_m = corrected.measurements[k].position_m - mean_m;
    EXPECT_NEAR(shift_m.norm(), CollectConfig().centroid_offset * 0.1, 0.01);
    EXPECT_NEAR(shift_m.dot(mean_m.normalized()), shift_m.norm(), 1e-9);
  }
  EXPECT_NEAR(corrected.common_errors.depth_sigma_m / 0.4, 0.1, 0.03);  // many tell that it is flat
}

TEST(CollectTarget, OfABallItIsTheCentre) {
  constexpr double kRadiusM = 0.3;
  RecordingMaker maker(18);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    const Eigen::Vector3d centre_m(15.0 + 0.01 * i, 2.0, 8.0);
    for (int k = 0; k < 30; ++k) {
      maker.Add(centre_m + maker.random.OnFacingSide(kRadiusM, centre_m.normalized()), kDrone);
    }
  }
  const auto nearer_m = [&](const Target& target) {
    double sum_m = 0.0;
    for (const Measurement& m : target.measurements) {
      const Eigen::Vector3d centre_m(15.0 + 0.1 * SecondsSinceBegin(m.time_ns), 2.0, 8.0);
      sum_m += (centre_m - m.position_m).dot(centre_m.normalized());
    }
    return sum_m / static_cast<double>(target.measurements.size());
  };
  const std::vector<Plot> path = PathOf(maker, 0, kFrames - 1);
  EXPECT_NEAR(nearer_m(Collect(maker, path)), 0.0, 0.02);
  const Target flat = Collect(maker, path, {}, {}, {Rule::kRoundBodies});
  EXPECT_NEAR(nearer_m(flat), (2.0 / 3.0 - 0.4 / 2.0) * kRadiusM, 0.02);
  EXPECT_NEAR(flat.common_errors.depth_sigma_m, 0.5 * kRadiusM / 2.0, 0.01);
}

// Beams meet a body wherever it happens to be between two of them: its middle is not theirs. If the
// number of beams that hit varies, it is nearer.
TEST(ElevationVariance, IsThatOfTheMiddleAboutTheBeamsThatHit) {
  constexpr double kWidthM = 0.4;
  constexpr double kHeightM = kWidthM / 2.0;
  Random random(4);
  for (const double step_m : {0.03, 0.05, 0.1, 0.13, 0.2, 0.7}) {
    double sum_m2 = 0.0;
    int count = 0;
    while (count < 4000) {
      const double lowest_m = random.Uniform(-step_m, 0.0) - kHeightM;  // beam below the body
      double mean_m = 0.0;
      int hits = 0;
      for (double beam_m = lowest_m; beam_m < kHeightM / 2.0; beam_m += step_m) {
        if (std::abs(beam_m) > kHeightM / 2.0) continue;
        mean_m += beam_m;
        ++hits;
      }
      if (hits == 0) continue;
      sum_m2 += std::pow(mean_m / hits, 2);
      ++count;
    }
    const double sigma_m = std::sqrt(ElevationVarianceM2(step_m, kWidthM / std::sqrt(12.0)));
    const double share = std::sqrt(sum_m2 / count) / sigma_m;
    EXPECT_LT(share, 1.05) << step_m;
    const double rest_m = std::abs(std::remainder(kHeightM, std::min(step_m, kHeightM)));
    EXPECT_GT(share, rest_m < 1e-9 ? 0.95 : 0.5) << step_m;
  }
}

TEST(CollectTarget, TheHeightAmongBeamsIsUncertainByAStepOrTheBody) {
  const RecordingMaker maker = Flight(13, 6.0);
  std::vector<Plot> path = PathOf(maker, 0, kFrames - 1);
  EXPECT_EQ(Collect(maker, path).common_errors.elevation_sigma_m, 0.0);
  for (Plot& plot : path) plot.beam_step_m = 0.1F;
  EXPECT_NEAR(Collect(maker, path).common_errors.elevation_sigma_m, 0.1 / std::sqrt(12.0), 1e-6);
  for (Plot& plot : path) plot.beam_step_m = 1.0F;
  EXPECT_NEAR(Collect(maker, path).common_errors.elevation_sigma_m, 0.5 * 0.1, 0.02);
}

TEST(CollectTarget, ABodyThatIsWiderThanHighIsUncertainAcrossMoreThanUpwards) {
  // Flat, four times as wide as high, and level flight, across which it shows but its height.
  constexpr double kWidthM = 0.4;
  RecordingMaker maker(16);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    const Eigen::Vector3d half_m(0.5 * kWidthM, 0.5 * kWidthM, 0.125 * kWidthM);
    const Eigen::Vector3d centre_m = DroneAt(testing::MiddleS(i));
    maker.AddBox(centre_m - half_m, centre_m + half_m, 5, kDrone);
  }
  const Target target = Collect(maker, PathOf(maker, 0, kFrames - 1));
  const double width_m = kWidthM / std::sqrt(12.0);
  EXPECT_NEAR(target.common_errors.depth_sigma_m / 0.5, width_m, 0.03);
  for (const Measurement& m : target.measurements) {
    const Eigen::Vector3d across = m.position_m.cross(Eigen::Vector3d::UnitZ()).normalized();
    const double returns_m2 = across.dot(m.covariance_m2 * across) - kCentreSigmaM * kCentreSigmaM;
    EXPECT_NEAR(std::sqrt(returns_m2 * m.support) / width_m, 1.0, 0.4);
    const Eigen::Vector3d up = across.cross(m.position_m).normalized();
    EXPECT_GT(across.dot(m.covariance_m2 * across), 1.5 * up.dot(m.covariance_m2 * up));
  }
}

TEST(CollectTarget, TheCentreLiesBetweenWhatTwoStationsSeeOfItsSides) {
  // Each sees but the side that faces it, and the drone flies between them.
  constexpr double kDepthM = 0.15;
  const std::vector<Eigen::Vector3f> viewpoints_m = {{0.0F, 0.0F, 0.0F}, {40.0F, 0.0F, 0.0F}};
  RecordingMaker maker(14, 2);
  for (int i = 0; i < kFrames; ++i) {
    for (std::uint32_t sensor = 0; sensor < 2; ++sensor) {
      maker.BeginFrame(i * kPeriodS, sensor);
      const Eigen::Vector3d centre_m = DroneAt(testing::MiddleS(i));
      const Eigen::Vector3d ray_m = centre_m - viewpoints_m[sensor].cast<double>();
      maker.AddBlob(centre_m - kDepthM * ray_m.normalized(), 0.1, 6, kDrone);
    }
  }
  const LearnedOccupancy learned(maker.recording);
  RobustConfig config;
  config.collect.centroid_offset = 1.5;  // of the spread of 0.1 m
  config.collect.sensor_bias_m = 1e-4;
  const std::vector<char> excluded(maker.labels.size(), 0);
  const Target target = CollectTarget(
      maker.recording, {learned.ModelAt(viewpoints_m[0]), learned.ModelAt(viewpoints_m[1])},
      PathOf(maker, 0, 2 * kFrames - 1), excluded, config, TrajectoryConfig());
  EXPECT_GT(ShareFound(maker, target, kDrone), 0.97);
  Eigen::Vector3d sums_m[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  for (const Measurement& m : target.measurements) {
    const std::size_t sensor = m.viewpoint_m.x() > 20.0 ? 1 : 0;
    EXPECT_EQ(m.viewpoint_m, viewpoints_m[sensor].cast<double>());
    sums_m[sensor] += m.position_m - DroneAt(SecondsSinceBegin(m.time_ns));
  }
  for (const Eigen::Vector3d& sum_m : sums_m) EXPECT_LT(sum_m.norm() / kFrames, 0.03);
}

TEST(CollectTarget, WhatTwoStationsDisagreeByIsSharedEvenly) {
  const Eigen::Vector3d offset_m(0.1, -0.2, 0.15);
  const Eigen::Vector3f apart_m(40.0F, 0.0F, 0.0F);
  RecordingMaker maker(15, 2);
  for (int i = 0; i < 2 * kFrames; ++i) {
    const auto sensor = static_cast<std::uint32_t>(i % 2);
    const double begin_s = 0.5 * i * kPeriodS;
    maker.BeginFrame(begin_s, sensor);
    const Eigen::Vector3d shift_m = sensor == 1 ? 0.5 * offset_m : -0.5 * offset_m;
    // The first one sees it better, which does not make its survey a better one.
    maker.AddBlob(DroneAt(begin_s + 0.5 * kPeriodS) + shift_m, 0.1, sensor == 0 ? 9 : 6, kDrone);
  }
  const LearnedOccupancy learned(maker.recording);
  RobustConfig config;
  config.collect.centroid_offset = 0.0;
  const std::vector<char> excluded(maker.labels.size(), 0);
  const auto mean_error_m = [&](const Eigen::Vector3f& other_m) -> Eigen::Vector3d {
    const Target target =
        CollectTarget(maker.recording, {learned.ModelAt(), learned.ModelAt(other_m)},
                      PathOf(maker, 0, 2 * kFrames - 1), excluded, config, TrajectoryConfig());
    Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
    for (const Measurement& m : target.measurements) {
      sum_m += m.position_m - DroneAt(SecondsSinceBegin(m.time_ns));
    }
    return sum_m / static_cast<double>(target.measurements.size());
  };
  EXPECT_LT(mean_error_m(apart_m).norm(), 0.03);
  EXPECT_LT((mean_error_m(Eigen::Vector3f::Zero()) + 0.5 * offset_m).norm(), 0.03);
}

TEST(CollectTarget, LeavesTheReturnsOfAWallBesideTheTrack) {
  RecordingMaker maker(5);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddBlob(DroneAt(testing::MiddleS(i)), 0.1, 5, kDrone);
    maker.AddBox({16.3, -12.0, 5.0}, {16.35, 12.0, 12.0}, 300, kWall);
  }
  const Target target = Collect(maker, PathOf(maker, 0, kFrames - 1));
  // It passes within 0.3 m of the wall twice.
  EXPECT_GT(ShareFound(maker, target, kDrone), 0.8);
  EXPECT_LT(ShareFound(maker, target, kWall) * 300 * kFrames, 0.04 * 5 * kFrames);
}

TEST(CollectTarget, ALampThatAFlightBeginsBesideKeepsItsReturns) {
  constexpr int kLamp = 3;
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    RecordingMaker maker(seed);
    const Eigen::Vector3d lamp_m = DroneAt(2.7);
    for (int i = 0; i < 4 * kFrames; ++i) {
      maker.BeginFrame(i * kPeriodS);
      const bool is_seen = i >= 30 && i < kFrames;
      if (is_seen) maker.AddBlob(DroneAt(testing::MiddleS(i)), 0.1, 1, kDrone);
      if (maker.random.Poisson(0.5) > 0) maker.AddBlob(lamp_m, 0.02, 1, kLamp);
    }
    const Target target = Collect(maker, PathOf(maker, 30, kFrames - 1));
    EXPECT_LT(ShareFound(maker, target, kLamp), 0.02) << seed;
    EXPECT_GT(ShareFound(maker, target, kDrone), 0.9) << seed;
    EXPECT_GT(SecondsSinceBegin(target.measurements.front().time_ns), 2.4) << seed;
  }
}

TEST(CollectTarget, ATargetThatComesBackToWhereItHoveredKeepsBothHovers) {
  const auto at = [](double time_s) -> Eigen::Vector3d {
    constexpr double kHover_s = 15.0;
    const double away_s = std::clamp(time_s - kHover_s, 0.0, 10.0);
    return {15.0 + 4.0 * std::sin(away_s * M_PI / 10.0), 2.0 * std::sin(away_s * M_PI / 5.0), 8.0};
  };
  for (std::uint32_t seed = 0; seed < 5; ++seed) {
    RecordingMaker maker(seed);
    for (int i = 0; i < 4 * kFrames; ++i) {
      maker.BeginFrame(i * kPeriodS);
      maker.AddBlob(at(testing::MiddleS(i)), 0.05, 1, kDrone);
    }
    const Target target = Collect(maker, PathOf(maker, 0, 4 * kFrames - 1));
    EXPECT_GT(ShareFound(maker, target, kDrone), 0.95) << seed;
  }
}

TEST(CollectTarget, LeavesWhatIsExcluded) {
  const RecordingMaker maker = Flight(6, 4.0);
  std::vector<char> excluded(maker.labels.size(), 0);
  for (std::size_t i = 0; i < excluded.size(); i += 2) excluded[i] = 1;
  const Target target = Collect(maker, PathOf(maker, 0, kFrames - 1), excluded);
  EXPECT_GT(target.returns.size(), excluded.size() / 3);
  for (const std::uint32_t i : target.returns) EXPECT_EQ(excluded[i], 0);
}

TEST(CollectTarget, GoesOnBeyondTheEndsOfThePathWhereTheReturnsAre) {
  const RecordingMaker maker = Flight(7, 4.0);
  const Target target = Collect(maker, PathOf(maker, 20, 80));
  EXPECT_GT(ShareFound(maker, target, kDrone), 0.97);
  EXPECT_LT(SecondsSinceBegin(target.measurements.front().time_ns), 0.3);
  EXPECT_GT(SecondsSinceBegin(target.measurements.back().time_ns), 9.7);
}

TEST(CollectTarget, EndsWhereTheReturnsEnd) {
  RecordingMaker maker(8);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    if (i >= 30 && i < 70) maker.AddBlob(DroneAt(testing::MiddleS(i)), 0.1, 4, kDrone);
    maker.AddBox({5, -15, 2}, {30, 15, 25}, 10);  // clutter goes on
  }
  const Target target = Collect(maker, PathOf(maker, 30, 69));
  EXPECT_GT(SecondsSinceBegin(target.measurements.front().time_ns), 2.5);
  EXPECT_LT(SecondsSinceBegin(target.measurements.back().time_ns), 7.5);
}

TEST(CollectTarget, LeavesALoneReturnBesideWhereATargetThatIsSeldomSeenWouldGoOn) {
  constexpr int kStray = 3;
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    RecordingMaker maker(seed);
    const Eigen::Vector3d side = maker.random.NormalVector(1.0).normalized();
    for (int i = 0; i < kFrames; ++i) {
      maker.BeginFrame(i * kPeriodS);
      const Eigen::Vector3d at_m = DroneAt(testing::MiddleS(i));
      if (i >= 20 && i < 70 && i % 3 == 0) maker.AddBlob(at_m, 0.1, 1, kDrone);
      if (i == 78) maker.Add(at_m + 1.2 * side, kStray);
    }
    const Target target = Collect(maker, PathOf(maker, 20, 69));
    EXPECT_EQ(ShareFound(maker, target, kStray), 0.0) << seed;
    EXPECT_GT(ShareFound(maker, target, kDrone), 0.9) << seed;
  }
}

TEST(CollectTarget, UsesTheTimesOfTheReturnsWhereTheyAreKnown) {
  // 20 m/s: within a frame 2 m. The returns of each frame come from its first half only, so that
  // the middle of the frame would be half a metre late.
  const Eigen::Vector3d velocity_mps(0.0, 20.0, 1.0);
  const auto at = [&](double time_s) -> Eigen::Vector3d {
    return Eigen::Vector3d(20.0, -60.0, 8.0) + velocity_mps * time_s;
  };
  RecordingMaker maker(9);
  for (int i = 0; i < 60; ++i) {
    maker.BeginFrame(i * kPeriodS);
    const TimeNs begin_ns = maker.recording.frames.back().begin_ns;
    for (int k = 0; k < 5; ++k) {
      const TimeNs time_ns = begin_ns + k * kPeriodNs / 10;
      maker.AddAt(time_ns, at(SecondsSinceBegin(time_ns)) + maker.random.NormalVector(0.05),
                  kDrone);
    }
  }
  std::vector<Plot> path = PathOf(maker, 0, 59);
  const Target target = Collect(maker, path);
  EXPECT_GT(ShareFound(maker, target, kDrone), 0.97);
  for (const Measurement& m : target.measurements) {
    EXPECT_LT((m.position_m - at(SecondsSinceBegin(m.time_ns))).norm(), 0.15);
  }
}

TEST(CollectTarget, WithoutPointTimesAFastTargetIsUncertainAlongItsMotion) {
  RecordingMaker maker(11);
  for (int i = 0; i < 60; ++i) {
    maker.BeginFrame(i * kPeriodS);
    for (int k = 0; k < 3; ++k) {
      const double time_s = testing::MiddleS(i) + maker.random.Uniform(-0.5, 0.5) * kPeriodS;
      maker.Add(Eigen::Vector3d(20.0, 20.0 * (time_s - 3.0), 8.0) + maker.random.NormalVector(0.05),
                kDrone);
    }
  }
  const Target target = Collect(maker, PathOf(maker, 0, 59));
  ASSERT_GT(target.measurements.size(), 50U);
  for (const Measurement& m : target.measurements) {
    // 2 m within a frame: uniformly distributed, that is a variance of 4 / 12 for each return.
    const double streak_m2 = m.covariance_m2(1, 1) - m.covariance_m2(0, 0);
    EXPECT_NEAR(streak_m2, 4.0 / 12.0 / m.support, 0.2 / m.support);
  }
}

// Frames of a drone at 4 m/s, half a second apart, measured within so much of it from their stamps.
RecordingMaker SlowFrames(std::uint32_t seed, double measured_s) {
  constexpr TimeNs kSlow_ns = 5 * kPeriodNs;
  RecordingMaker maker(seed);
  maker.recording.sensors[0].frame_period_ns = kSlow_ns;
  for (int i = 0; i < 20; ++i) {
    maker.BeginFrame(0.5 * i);
    maker.recording.frames.back().end_ns += kSlow_ns - kPeriodNs;
    for (int k = 0; k < 6; ++k) {
      const double time_s = 0.5 * i + maker.random.Uniform(0.0, measured_s);
      maker.AddBlob({15.0, 4.0 * time_s - 20.0, 8.0}, 0.1, 1, kDrone);
    }
  }
  return maker;
}

// Every fifth frame of a LiDAR with ten a second, and one that takes half a second for a frame.
TEST(CollectTarget, TheStreaksOfATargetTellHowLongSlowFramesWereMeasured) {
  for (const std::uint32_t seed : {21U, 22U, 23U}) {
    const RecordingMaker short_frames = SlowFrames(seed, 0.1);
    const Target thinned = Collect(short_frames, PathOf(short_frames, 0, 19));
    EXPECT_NEAR(static_cast<double>(thinned.time_bias_ns) * kSecondsPerNs, -0.2, 0.002);
    const RecordingMaker long_frames = SlowFrames(seed, 0.5);
    const Target whole = Collect(long_frames, PathOf(long_frames, 0, 19));
    EXPECT_NEAR(static_cast<double>(whole.time_bias_ns) * kSecondsPerNs, 0.0, 0.002);
  }
}

TEST(CollectTarget, FramesOfALidarThatGivesTenASecondAreNotLate) {
  const RecordingMaker maker = Flight(24, 4.0);
  EXPECT_EQ(Collect(maker, PathOf(maker, 0, kFrames - 1)).time_bias_ns, 0);
}

// A drone that speeds up to 9 m/s, all returns of a frame of one instant or each of its own.
RecordingMaker FastFrames(bool is_instant, bool is_timed) {
  RecordingMaker maker(26);
  for (int i = 0; i < 60; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.recording.frames.back().is_timed = is_timed;
    for (int k = 0; k < 6; ++k) {
      const double time_s = (i + (is_instant ? 0.8 : maker.random.Uniform(0.0, 1.0))) * kPeriodS;
      maker.AddBlob({15.0, 0.75 * time_s * time_s - 12.0, 8.0}, 0.1, 1, kDrone);
    }
  }
  return maker;
}

TEST(CollectTarget, WhetherADroneIsHitAtOneInstantOfEachFrameTellsTheErrorOfItsTimes) {
  const auto sigma_s = [](const RecordingMaker& maker) {
    return Collect(maker, PathOf(maker, 0, 59)).common_errors.time_sigma_s;
  };
  EXPECT_NEAR(sigma_s(FastFrames(true, false)), 0.1 / std::sqrt(12.0), 0.001);
  EXPECT_NEAR(sigma_s(FastFrames(false, false)), 0.0, 0.001);
  EXPECT_EQ(sigma_s(FastFrames(true, true)), 0.0);
  RecordingMaker doubtful = FastFrames(true, true);
  for (FrameInfo& frame : doubtful.recording.frames) frame.time_sigma_s = 0.25F;
  EXPECT_EQ(sigma_s(doubtful), 0.25);
}

// Its stamps stand at the end of what was measured, wherever that began.
TEST(CollectTarget, AStampAtTheEndOfASlowFrameIsNearWhatWasMeasured) {
  RecordingMaker maker = SlowFrames(25, 0.1);
  for (FrameInfo& frame : maker.recording.frames) frame.stamp_ns = frame.end_ns;
  EXPECT_NEAR(
      static_cast<double>(Collect(maker, PathOf(maker, 0, 19)).time_bias_ns) * kSecondsPerNs, 0.2,
      0.002);
}

TEST(CollectTarget, IsEmptyWhereAllReturnsAreExcluded) {
  const RecordingMaker maker = Flight(10, 4.0);
  const std::vector<char> all(maker.labels.size(), 1);
  EXPECT_TRUE(Collect(maker, PathOf(maker, 0, kFrames - 1), all).measurements.empty());
}

}  // namespace
}  // namespace unlidar
