#include "recording/robust.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>
#include <set>
#include <vector>

#include "tests/draws.hpp"
#include "tests/fit_trajectory.hpp"
#include "tests/fitted_scene.hpp"
#include "tests/learned_occupancy.hpp"
#include "tests/synthetic_recording.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {
namespace {

using testing::kPeriodNs;
using testing::kPeriodS;
using testing::MiddleS;
using testing::RecordingMaker;
using testing::SecondsSinceBegin;

constexpr int kFrames = 120;
constexpr double kGround_m = -1.5;
constexpr int kDrone = 1;
constexpr int kWalker = 2;

using Flight = std::function<Eigen::Vector3d(double time_s)>;
using Filler = std::function<void(double time_s, RecordingMaker*)>;

// Twelve seconds of a yard with a house, a tree, stray returns from anywhere, and what `fill` adds.
RecordingMaker Yard(std::uint32_t seed, const Filler& fill) {
  RecordingMaker maker(seed);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddGround(kGround_m, 20.0, 800);
    maker.AddBox({18.0, -6.0, kGround_m}, {18.05, 6.0, 5.0}, 200);
    maker.AddBlob({-12.0, 8.0, 3.0}, 1.0, 60);
    maker.AddBox({-25.0, -25.0, 0.0}, {25.0, 25.0, 25.0}, maker.random.Poisson(1.0));
    fill(MiddleS(i), &maker);
  }
  return maker;
}

Filler DroneOn(const Flight& at, double returns_per_frame) {
  return [=](double time_s, RecordingMaker* maker) {
    maker->AddBlob(at(time_s), 0.1, maker->random.Poisson(returns_per_frame), kDrone);
  };
}

Eigen::Vector3d Transit(double time_s) {
  return {9.0 - 0.3 * time_s, 2.0 * (time_s - 6.0), 5.0 + std::sin(0.6 * time_s)};
}

RobustResult Find(const Recording& recording) {
  return FindTargetsRobust(recording, RobustConfig(), TrajectoryConfig());
}

// Root mean square distance from the truth of the trajectory, at every frame of its span.
double RmseM(const Target& target, const Flight& truth) {
  const Trajectory trajectory = FitTrajectory(target.measurements, TrajectoryConfig());
  double sum = 0.0;
  int count = 0;
  for (TimeNs t = trajectory.begin_ns(); t <= trajectory.end_ns(); t += kPeriodNs) {
    sum += (trajectory.At(t).position_m - truth(SecondsSinceBegin(t))).squaredNorm();
    ++count;
  }
  return std::sqrt(sum / count);
}

double SpanS(const Target& target) {
  return SecondsSinceBegin(target.measurements.back().time_ns) -
         SecondsSinceBegin(target.measurements.front().time_ns);
}

void ExpectOneDrone(const RobustResult& result, const Flight& truth, double least_span_s) {
  ASSERT_EQ(result.targets.size(), 1U);
  const Target& target = result.targets.front();
  EXPECT_LT(RmseM(target, truth), 0.3);
  EXPECT_GT(SpanS(target), least_span_s);
  EXPECT_GE(target.score, result.counts.score_threshold);
}

TEST(FindTargetsRobust, FindsADroneInTransit) {
  for (std::uint32_t seed = 0; seed < testing::Draws(3U); ++seed) {
    const RecordingMaker maker = Yard(seed, DroneOn(Transit, 4.0));
    const RobustResult result = Find(maker.recording);
    ExpectOneDrone(result, Transit, 11.0);
    double own = 0.0;
    for (const std::uint32_t i : result.targets.front().returns) {
      own += maker.labels[i] == kDrone ? 1.0 : 0.0;
    }
    const auto of_drone =
        static_cast<double>(std::count(maker.labels.begin(), maker.labels.end(), kDrone));
    EXPECT_GT(own, 0.9 * of_drone);
    EXPECT_GT(own, 0.98 * static_cast<double>(result.targets.front().returns.size()));
  }
}

TEST(FindTargetsRobust, FindsADroneThatHoversForAThirdOfTheTime) {
  const Flight hover = [](double time_s) -> Eigen::Vector3d {
    const double moved_s = time_s < 4.0 ? time_s - 4.0 : std::max(0.0, time_s - 8.0);
    return {8.0, 2.0 + 2.5 * moved_s, 6.0};
  };
  ExpectOneDrone(Find(Yard(1, DroneOn(hover, 5.0)).recording), hover, 11.0);
}

TEST(FindTargetsRobust, FindsADroneThatHoversAllTheTimeInTheAirButNoThingOnAPole) {
  const Flight hover = [](double time_s) -> Eigen::Vector3d {
    return {8.0, 2.0 + 0.1 * std::sin(time_s), 8.0};
  };
  for (std::uint32_t seed = 0; seed < testing::Draws(4U); ++seed) {
    const RecordingMaker in_air = Yard(seed, DroneOn(hover, 5.0));
    ExpectOneDrone(Find(in_air.recording), hover, 11.0);
    const RecordingMaker on_pole = Yard(seed, [&](double time_s, RecordingMaker* maker) {
      DroneOn(hover, 5.0)(time_s, maker);
      maker->AddBox({7.95, 1.95, kGround_m}, {8.05, 2.05, 8.0}, 40);
    });
    EXPECT_TRUE(Find(on_pole.recording).targets.empty()) << seed;
  }
}

TEST(FindTargetsRobust, FindsADroneThatIsSeenInEveryFourthFrame) {
  const Flight far = [](double time_s) -> Eigen::Vector3d {
    return {-22.0, 3.0 * (time_s - 6.0), 14.0};
  };
  ExpectOneDrone(Find(Yard(2, DroneOn(far, 0.3)).recording), far, 9.0);
}

TEST(FindTargetsRobust, FindsTwoDronesThatPassHalfAMetreFromEachOther) {
  const Flight other = [](double time_s) -> Eigen::Vector3d {
    return {7.2 + 1.5 * (time_s - 6.0), 0.3, 4.8};  // meets the first after 6 s
  };
  const RecordingMaker maker = Yard(3, [&](double time_s, RecordingMaker* m) {
    DroneOn(Transit, 4.0)(time_s, m);
    DroneOn(other, 4.0)(time_s, m);
  });
  const RobustResult result = Find(maker.recording);
  ASSERT_EQ(result.targets.size(), 2U);
  EXPECT_GE(result.targets[0].score, result.targets[1].score);
  for (const Flight& truth : {Flight(Transit), other}) {
    EXPECT_LT(std::min(RmseM(result.targets[0], truth), RmseM(result.targets[1], truth)), 0.3);
  }
  std::vector<std::uint32_t> shared;
  std::set_intersection(result.targets[0].returns.begin(), result.targets[0].returns.end(),
                        result.targets[1].returns.begin(), result.targets[1].returns.end(),
                        std::back_inserter(shared));
  EXPECT_TRUE(shared.empty());
}

TEST(FindTargetsRobust, LosesNothingOfADroneThatShowsAsTwoForAWhile) {
  // For the search either of them may go on, so that one path ends where the drone was two plots
  // and the other has the rest of the flight.
  for (std::uint32_t seed = 0; seed < testing::Draws(40U); ++seed) {
    const RecordingMaker maker = Yard(seed, [](double time_s, RecordingMaker* m) {
      if (std::abs(time_s - 6.0) > 0.3) return DroneOn(Transit, 0.6)(time_s, m);
      for (const double aside_m : {-0.4, 0.4}) {
        const Eigen::Vector3d part_m = Transit(time_s) + Eigen::Vector3d(aside_m, 0.0, 0.0);
        m->AddBlob(part_m, 0.05, 1 + m->random.Poisson(1.0), kDrone);
      }
    });
    std::set<std::uint32_t> found;
    for (const Target& target : Find(maker.recording).targets) {
      found.insert(target.returns.begin(), target.returns.end());
    }
    double all = 0.0;
    double own = 0.0;
    for (std::uint32_t i = 0; i < maker.labels.size(); ++i) {
      const double time_s = SecondsSinceBegin(maker.recording.times_ns[i]);
      if (maker.labels[i] != kDrone || std::abs(time_s - 6.0) < 0.6) continue;
      all += 1.0;
      own += static_cast<double>(found.count(i));
    }
    EXPECT_GT(own, 0.915 * all) << seed;
  }
}

TEST(FindTargetsRobust, FindsNothingInAGustButADroneThatPassesThere) {
  // A bush of 3 m returns something for two seconds, each time at another place, and never again.
  const auto gust = [](double time_s, RecordingMaker* m) {
    if (std::abs(time_s - 6.0) > 1.0) return;
    m->AddBox({7.0, -2.0, 3.5}, {10.0, 1.0, 6.5}, m->random.Poisson(1.5));
  };
  for (std::uint32_t seed = 0; seed < testing::Draws(30U); ++seed) {
    EXPECT_TRUE(Find(Yard(seed, gust).recording).targets.empty()) << seed;
    const RecordingMaker both = Yard(seed, [&](double time_s, RecordingMaker* m) {
      gust(time_s, m);
      DroneOn(Transit, 4.0)(time_s, m);
    });
    ExpectOneDrone(Find(both.recording), Transit, 11.0);
  }
}

TEST(FindTargetsRobust, ReportsNoHeadsAboveTheParapetOfABridgeButTheDroneAboveThem) {
  const auto bridge = [](double time_s, RecordingMaker* m) {
    m->AddBox({9.0, -15.0, 3.5}, {9.2, 15.0, 5.0}, 400);
    for (const double mps : {1.4, -1.2}) {
      const double y_m = mps * (time_s - 6.0);
      m->AddBox({9.6, y_m - 0.2, 5.1}, {9.9, y_m + 0.2, 5.6}, 1 + m->random.Poisson(4.0), kWalker);
    }
  };
  const Flight above = [](double time_s) -> Eigen::Vector3d {
    return {9.0, 1.5 * (time_s - 6.0), 8.0 + std::sin(0.6 * time_s)};
  };
  RobustConfig without;
  without.disabled_rules = {Rule::kOnStructure};
  for (std::uint32_t seed = 0; seed < testing::Draws(3U); ++seed) {
    const RecordingMaker alone = Yard(seed, bridge);
    EXPECT_TRUE(Find(alone.recording).targets.empty()) << seed;
    EXPECT_EQ(FindTargetsRobust(alone.recording, without, TrajectoryConfig()).targets.size(), 2U);
    const RecordingMaker both = Yard(seed, [&](double time_s, RecordingMaker* m) {
      bridge(time_s, m);
      DroneOn(above, 4.0)(time_s, m);
    });
    ExpectOneDrone(Find(both.recording), above, 11.0);
  }
}

// A path may go on from the cloud to the drone, and is refused by its width.
TEST(FindTargetsRobust, ADroneThatAppearsBesideACloudIsNoPartOfIt) {
  const Flight drone = [](double time_s) -> Eigen::Vector3d {
    return {10.0, 3.4 - 1.5 * (time_s - 8.0), 5.5};
  };
  const Filler fill = [&](double time_s, RecordingMaker* maker) {
    if (time_s < 6.0) maker->AddBlob({10.0, 1.0 + 0.4 * time_s, 5.0}, 0.5, 6);
    if (time_s > 8.0) maker->AddBlob(drone(time_s), 0.08, maker->random.Poisson(4.0), kDrone);
  };
  RobustConfig without;
  without.disabled_rules = {Rule::kCloudParts};
  int num_lost = 0;
  for (std::uint32_t seed = 0; seed < testing::Draws(3U); ++seed) {
    const Recording recording = Yard(seed, fill).recording;
    ExpectOneDrone(Find(recording), drone, 3.5);
    num_lost += FindTargetsRobust(recording, without, TrajectoryConfig()).targets.empty() ? 1 : 0;
  }
  EXPECT_GT(num_lost, 0);
}

TEST(FindTargetsRobust, FindsNothingInAnEmptySky) {
  for (std::uint32_t seed = 0; seed < testing::Draws(20U); ++seed) {
    const RecordingMaker maker = Yard(seed, [](double, RecordingMaker*) {});
    EXPECT_TRUE(Find(maker.recording).targets.empty()) << seed;
  }
}

TEST(FindTargetsRobust, FindsNothingWhereNothingIs) {
  EXPECT_TRUE(Find(Recording()).targets.empty());
  RecordingMaker maker(1);
  for (int i = 0; i < kFrames; ++i) maker.BeginFrame(i * kPeriodS);
  EXPECT_TRUE(Find(maker.recording).targets.empty());
  maker.Add({1.0, 2.0, 3.0});
  EXPECT_TRUE(Find(maker.recording).targets.empty());
}

TEST(FindTargetsRobust, ReportsNoWalkersAndNoCarButTheDroneAboveThem) {
  const auto pass = [](double time_s, RecordingMaker* maker) {
    const auto add = [&](double x, double y, const Eigen::Vector2d& half_m, double height_m,
                         int count) {
      maker->AddBox({x - half_m.x(), y - half_m.y(), kGround_m},
                    {x + half_m.x(), y + half_m.y(), kGround_m + height_m}, count, kWalker);
    };
    add(7.0, 1.3 * (time_s - 5.0), {0.25, 0.25}, 1.75, 15);
    add(10.0 - 1.1 * time_s, -9.0, {0.25, 0.25}, 1.8, 12);
    add(13.0, 7.0 * (time_s - 6.0), {0.9, 2.2}, 1.5, 40);
    // Too few returns to know its shape: that it stays near the ground must do.
    add(-17.0, 1.4 * (time_s - 6.0), {0.25, 0.25}, 1.75, 2);
  };
  for (std::uint32_t seed = 0; seed < testing::Draws(3U); ++seed) {
    EXPECT_TRUE(Find(Yard(seed, pass).recording).targets.empty()) << seed;
  }
  const RecordingMaker maker = Yard(4, [&](double time_s, RecordingMaker* m) {
    pass(time_s, m);
    DroneOn(Transit, 4.0)(time_s, m);
  });
  ExpectOneDrone(Find(maker.recording), Transit, 11.0);
}

TEST(FindTargetsRobust, FindsADroneThatStaysLowButNobodyWhoWalksThere) {
  const Flight low = [](double time_s) -> Eigen::Vector3d {
    return {9.0 - 0.3 * time_s, 2.0 * (time_s - 6.0), kGround_m + 1.5 + 0.3 * std::sin(time_s)};
  };
  ExpectOneDrone(Find(Yard(41, DroneOn(low, 8.0)).recording), low, 11.0);
  for (const double returns_per_frame : {2.0, 8.0, 30.0}) {
    const Filler walker = [&](double time_s, RecordingMaker* maker) {
      const Eigen::Vector3d foot_m(9.0 - 0.3 * time_s, 1.4 * (time_s - 6.0), kGround_m);
      maker->AddBox(foot_m - Eigen::Vector3d(0.2, 0.2, 0.0),
                    foot_m + Eigen::Vector3d(0.2, 0.2, 1.7),
                    maker->random.Poisson(returns_per_frame), kWalker);
    };
    EXPECT_TRUE(Find(Yard(42, walker).recording).targets.empty()) << returns_per_frame;
  }
}

TEST(FindTargetsRobust, UsesTheTimesOfTheReturns) {
  // At 15 m/s, all returns within the first fifth of a frame: its middle is 0.6 m farther on.
  const Flight fast = [](double time_s) -> Eigen::Vector3d {
    return {12.0, 15.0 * (time_s - 6.0), 9.0};
  };
  RecordingMaker maker(5);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddGround(kGround_m, 20.0, 800);
    const TimeNs begin_ns = maker.recording.frames.back().begin_ns;
    for (int k = 0; k < 4; ++k) {
      const TimeNs time_ns = begin_ns + k * kPeriodNs / 20;
      maker.AddAt(time_ns, fast(SecondsSinceBegin(time_ns)) + maker.random.NormalVector(0.05),
                  kDrone);
    }
  }
  const RobustResult result = Find(maker.recording);
  ASSERT_EQ(result.targets.size(), 1U);
  EXPECT_LT(RmseM(result.targets.front(), fast), 0.1);
}

// The distances of two results at the frames of the first one's span.
void ExpectSameTargets(const RobustResult& found, const RobustResult& expected,
                       const Eigen::Matrix3d& turn, TimeNs shift_ns, double tolerance_m) {
  ASSERT_EQ(found.targets.size(), expected.targets.size());
  for (std::size_t k = 0; k < found.targets.size(); ++k) {
    const Trajectory a = FitTrajectory(expected.targets[k].measurements, TrajectoryConfig());
    const Trajectory b = FitTrajectory(found.targets[k].measurements, TrajectoryConfig());
    for (TimeNs t = a.begin_ns(); t <= a.end_ns(); t += kPeriodNs) {
      EXPECT_LT((turn * a.At(t).position_m - b.At(t + shift_ns).position_m).norm(), tolerance_m)
          << SecondsSinceBegin(t);
    }
  }
}

TEST(FindTargetsRobust, DoesNotDependOnTheOrderOfTheReturnsOfAFrame) {
  const RecordingMaker maker = Yard(6, DroneOn(Transit, 4.0));
  const RobustResult expected = Find(maker.recording);
  ASSERT_EQ(expected.targets.size(), 1U);
  Recording shuffled = maker.recording;
  std::vector<std::uint32_t> origin(shuffled.points_m.size());
  std::iota(origin.begin(), origin.end(), 0U);
  testing::Random random(7);
  for (const FrameInfo& frame : shuffled.frames) {
    for (std::uint32_t n = frame.last_return - frame.first_return; n > 1; --n) {
      const std::uint32_t i = frame.first_return + n - 1;
      const std::uint32_t j = frame.first_return + random.Index(n);
      std::swap(shuffled.points_m[i], shuffled.points_m[j]);
      std::swap(origin[i], origin[j]);
    }
  }
  const RobustResult found = Find(shuffled);
  ExpectSameTargets(found, expected, Eigen::Matrix3d::Identity(), 0, 1e-4);
  std::set<std::uint32_t> returns;
  for (const std::uint32_t i : found.targets.front().returns) returns.insert(origin[i]);
  EXPECT_EQ(returns, std::set<std::uint32_t>(expected.targets.front().returns.begin(),
                                             expected.targets.front().returns.end()));
}

TEST(FindTargetsRobust, ATurnedAndLaterRecordingGivesTurnedAndLaterTargets) {
  const RecordingMaker maker = Yard(8, DroneOn(Transit, 4.0));
  const RobustResult expected = Find(maker.recording);
  constexpr TimeNs kShiftNs = 987'654'321'987;
  constexpr std::array<double, 3> kAngles_rad = {0.4, 0.0, 2.0};
  for (std::size_t k = 0; k < testing::Draws(kAngles_rad.size()); ++k) {
    const double angle_rad = kAngles_rad.at(k);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    Recording turned = maker.recording;
    for (Eigen::Vector3f& p : turned.points_m) p = turn.cast<float>() * p;
    turned.times_ns.clear();
    for (std::size_t i = 0; i < turned.points_m.size(); ++i) {
      turned.times_ns.push_back(maker.recording.times_ns[i] + kShiftNs);
    }
    for (FrameInfo& frame : turned.frames) {
      frame.stamp_ns += kShiftNs;
      frame.begin_ns += kShiftNs;
      frame.end_ns += kShiftNs;
    }
    // Voxels fall elsewhere, so that single returns may be judged differently.
    ExpectSameTargets(Find(turned), expected, turn, kShiftNs, angle_rad == 0.0 ? 1e-9 : 0.15);
  }
}

TEST(FindTargetsRobust, CountsWhatItMet) {
  const RobustConfig config;
  const RecordingMaker maker = Yard(9, DroneOn(Transit, 4.0));
  const RobustResult result = FindTargetsRobust(maker.recording, config, TrajectoryConfig());
  testing::LearnedOccupancy learned(maker.recording);
  std::vector<Eigen::Vector3f> structure_m;
  learned.occupancy().GetStructure(&structure_m);
  const Ground ground = GroundOf(structure_m);
  // Ground is none of it, whether known by its occupancy or not. No structure floats here.
  std::size_t num_free = 0;
  for (std::size_t i = 0; i < maker.labels.size(); ++i) {
    if (learned.Judge(maker.recording, i).is_structure) continue;
    num_free += ground.IsGround(maker.recording.points_m[i]) ? 0U : 1U;
  }
  EXPECT_EQ(result.counts.unexplained_returns, num_free);
  EXPECT_GE(result.counts.paths, result.targets.size());
  EXPECT_GE(result.counts.plots, result.targets.front().measurements.size());
  constexpr double kModels = 6.0;  // three agilities, two birth speeds
  const double num_starts = kModels * static_cast<double>(result.counts.plots);
  EXPECT_NEAR(result.counts.score_threshold,
              std::log(num_starts) - std::log(config.false_alarms_per_recording), 1e-9);
  EXPECT_EQ(result.counts.false_alarms, config.false_alarms_per_recording);
}

TEST(FindTargetsRobust, WhatATargetShowsBesideItsPathIsNoClutter) {
  // A large drone that hovers shows as two plots in many frames, of which a path takes one.
  const Flight hover = [](double time_s) -> Eigen::Vector3d {
    return {8.0, 2.0 + 2.5 * std::max(0.0, time_s - 8.0), 6.0};
  };
  const Filler fill = [&](double time_s, RecordingMaker* maker) {
    for (const double side : {-0.32, 0.32}) {
      maker->AddBlob(hover(time_s) + Eigen::Vector3d(side, 0.0, 0.0), 0.03, 3, kDrone);
    }
  };
  EXPECT_EQ(Find(Yard(3, fill).recording).targets.size(), 1U);
}

// A drone that comes by the same places again and again, where its own plots of other times are
// clutter unless they are known to be of a target.
Eigen::Vector3d ToAndFro(double time_s) { return {8.0, 4.0 * std::sin(1.5 * time_s), 6.0}; }

double ScoreOfToAndFro(const std::vector<double>& sigma_a_mps2, const std::vector<Rule>& without) {
  RobustConfig config;
  config.tracker.sigma_a_mps2 = sigma_a_mps2;
  config.disabled_rules = without;
  const Recording recording = Yard(4, DroneOn(ToAndFro, 4.0)).recording;
  const RobustResult result = FindTargetsRobust(recording, config, TrajectoryConfig());
  EXPECT_EQ(result.targets.size(), 1U);
  return result.targets.empty() ? 0.0 : result.targets.front().score;
}

TEST(FindTargetsRobust, TheTargetsOfARoughSearchAreNoClutter) {
  const double score = ScoreOfToAndFro({1.0, 3.0, 8.0}, {});
  EXPECT_GT(score, ScoreOfToAndFro({1.0, 3.0, 8.0}, {Rule::kSecondRound}) + 50.0);
}

TEST(FindTargetsRobust, TargetsThatARoughSearchMissesAreNoClutterEither) {
  // The median sigma_a, with which it searches, is far below the accelerations of the drone.
  const double score = ScoreOfToAndFro({0.01, 0.02, 8.0}, {});
  EXPECT_NEAR(score, ScoreOfToAndFro({8.0}, {}), 1.0);
  EXPECT_GT(score, ScoreOfToAndFro({0.01, 0.02, 8.0}, {Rule::kSecondRound}) + 50.0);
}

// The same, seen from a sensor that stands elsewhere.
Recording Moved(Recording recording, const Eigen::Vector3f& by_m) {
  for (SensorInfo& sensor : recording.sensors) sensor.origin_m += by_m;
  for (Eigen::Vector3f& point_m : recording.points_m) point_m += by_m;
  return recording;
}

TEST(FindTargetsRobust, FindsTheSameWhereverItsSensorStands) {
  const Eigen::Vector3f by_m(256.0F, -512.0F, 16.0F);
  const Recording yard = Yard(5, DroneOn(Transit, 2.0)).recording;
  const RobustResult at_origin = Find(yard);
  const RobustResult elsewhere = Find(Moved(yard, by_m));
  ASSERT_EQ(at_origin.targets.size(), 1U);
  ASSERT_EQ(elsewhere.targets.size(), 1U);
  const Target& a = at_origin.targets.front();
  const Target& b = elsewhere.targets.front();
  // Coordinates so far out are coarser, so that a return at the edge of something may change sides.
  EXPECT_NEAR(static_cast<double>(b.returns.size()), static_cast<double>(a.returns.size()), 2.0);
  EXPECT_NEAR(b.score, a.score, 0.02 * a.score);
  ExpectOneDrone(
      elsewhere,
      [&](double time_s) -> Eigen::Vector3d { return Transit(time_s) + by_m.cast<double>(); },
      11.0);
}

// Returns of both, frame by frame in order of time, with the sensors of `b` behind those of `a`.
Recording Together(const Recording& a, const Recording& b) {
  Recording both;
  both.sensors = a.sensors;
  both.sensors.insert(both.sensors.end(), b.sensors.begin(), b.sensors.end());
  for (std::size_t f = 0; f < a.frames.size(); ++f) {
    for (const Recording* of : {&a, &b}) {
      FrameInfo frame = of->frames[f];
      const auto first = static_cast<std::uint32_t>(both.points_m.size());
      for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
        both.points_m.push_back(of->points_m[i]);
        both.times_ns.push_back(of->times_ns[i]);
      }
      frame.first_return = first;
      frame.last_return = static_cast<std::uint32_t>(both.points_m.size());
      if (of == &b) frame.sensor += static_cast<std::uint32_t>(a.sensors.size());
      both.frames.push_back(frame);
    }
  }
  return both;
}

TEST(FindTargetsRobust, FindsADroneBetweenTwoStationsAsOneTrack) {
  // It leaves the yard of the first and comes to that of the second; each sees it within 70 m.
  const Eigen::Vector3d other_m(120.0, 0.0, 0.0);
  const Flight across = [](double time_s) -> Eigen::Vector3d {
    return {8.0 + 9.0 * time_s, 9.0, 12.0 + std::sin(0.6 * time_s)};
  };
  const auto seen_from = [&](std::uint32_t seed, const Eigen::Vector3d& viewpoint_m) {
    const Filler drone = [&, viewpoint_m](double time_s, RecordingMaker* maker) {
      const Eigen::Vector3d ray_m = across(time_s) - viewpoint_m;
      if (ray_m.norm() > 70.0) return;
      maker->AddBlob(ray_m, 0.1, maker->random.Poisson(1000.0 / ray_m.squaredNorm()), kDrone);
    };
    return Moved(Yard(seed, drone).recording, viewpoint_m.cast<float>());
  };
  for (std::uint32_t seed = 0; seed < testing::Draws(3U); ++seed) {
    const Recording both =
        Together(seen_from(seed, Eigen::Vector3d::Zero()), seen_from(seed + 7, other_m));
    ExpectOneDrone(Find(both), across, 11.0);
  }
}

TEST(FindTargetsRobust, FindsNothingWhereTwoStationsSeeNoDrone) {
  const Filler nothing = [](double, RecordingMaker*) {};
  for (std::uint32_t seed = 0; seed < testing::Draws(3U); ++seed) {
    const Recording both =
        Together(Yard(seed, nothing).recording,
                 Moved(Yard(seed + 7, nothing).recording, Eigen::Vector3f(60.0F, 8.0F, 1.0F)));
    EXPECT_TRUE(Find(both).targets.empty()) << seed;
  }
}

}  // namespace
}  // namespace unlidar
