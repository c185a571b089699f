#include "tracking/alternative_modes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/synthetic_plots.hpp"
#include "tracking/scan_schedule.hpp"

namespace unlidar {
namespace {

using testing::AddClutter;
using testing::AddFlight;
using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::MakePlot;
using testing::Members;
using testing::Random;
using testing::SortByTime;
using testing::WatchOver;

constexpr int kFrames = 60;
constexpr int kForkFrame = 40;
constexpr double kLogClutter = -9.0;
constexpr double kLogClutterOfFork = -5.0;

Eigen::Vector3d Straight(double time_s) { return {3.0 * time_s - 6.0, 10.0, 8.0}; }

// Which leaves that way to one side or the other.
Eigen::Vector3d Aside(double time_s, double side) {
  const double since_s = time_s - kForkFrame * kPeriodS;
  return Straight(time_s) + side * Eigen::Vector3d(0.0, 1.5 * since_s * since_s, 0.0);
}

// A flight that is seen now and then until it forks: then three times on either side, but for
// frames with a number that `lead` divides on the one alone.
std::vector<Plot> Fork(int lead) {
  std::vector<Plot> plots;
  for (int i = 0; i <= kForkFrame; i += 4) {
    plots.push_back(MakePlot(kBeginNs + i * kPeriodNs, Straight(i * kPeriodS), kLogClutter));
  }
  for (int i = kForkFrame + 4; i <= kForkFrame + 12; i += 4) {
    const TimeNs time_ns = kBeginNs + i * kPeriodNs;
    plots.push_back(MakePlot(time_ns, Aside(i * kPeriodS, 1.0), kLogClutterOfFork));
    if (i % lead == 0) continue;
    plots.push_back(MakePlot(time_ns, Aside(i * kPeriodS, -1.0), kLogClutterOfFork));
  }
  // The sensor watches on.
  plots.push_back(MakePlot(kBeginNs + kFrames * kPeriodNs, {-90.0, -90.0, 40.0}, kLogClutter));
  return plots;
}

struct Doubted {
  std::vector<Plot> path;
  std::vector<AlternativeMode> alternative_modes;
};

// The best path through all plots, seen `num_more` times behind it.
Doubted DoubtBest(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                  std::size_t num_more = 0) {
  const TrackerConfig config;
  const std::vector<Path> paths = FindPaths(plots, scan_schedule, config);
  if (paths.empty()) return {};
  Doubted result;
  result.path = Members(plots, paths.front().plots);
  std::vector<Measurement> measurements(num_more);
  for (Measurement& m : measurements) {
    m.time_ns = result.path.back().time_ns + kPeriodNs;
    m.log_ratio = 2.0;
  }
  result.alternative_modes =
      AlternativeModesOf(0, paths, plots, scan_schedule, config, measurements);
  return result;
}

Doubted DoubtBest(const std::vector<Plot>& plots, std::size_t num_more = 0) {
  return DoubtBest(plots, WatchOver(plots), num_more);
}

double ProbabilityAt(const std::vector<AlternativeMode>& alternative_modes, int frame) {
  double most = 0.0;
  for (const AlternativeMode& mode : alternative_modes) {
    if (mode.time_ns == kBeginNs + frame * kPeriodNs) most = std::max(most, mode.probability);
  }
  return most;
}

// Where the target is in the mean of all ways, the path is on one side and the alternative_modes on
// the other.
TEST(AlternativeModesOf, BetweenTwoWaysThatAreAlikeTheMeanIsTheMiddle) {
  const Doubted found = DoubtBest(Fork(kFrames));
  ASSERT_EQ(found.path.back().frame, kForkFrame + 12U);
  const double side = found.path.back().position_m.y() > 10.0 ? 1.0 : -1.0;
  EXPECT_EQ(ProbabilityAt(found.alternative_modes, kForkFrame / 2), 0.0);
  int num_frames = 0;
  for (const AlternativeMode& mode : found.alternative_modes) {
    const double frame = static_cast<double>(mode.time_ns - kBeginNs) / kPeriodNs;
    if (frame < kForkFrame + 6 || frame > kForkFrame + 11) continue;
    ++num_frames;
    EXPECT_GT(mode.probability, 0.45) << frame;
    const double path_m = Aside(frame * kPeriodS, side).y() - 10.0;
    const double other_m = mode.position_m.y() - 10.0;
    const double mean_m = (1.0 - mode.probability) * path_m + mode.probability * other_m;
    EXPECT_LT(std::abs(mean_m), 0.3 * std::abs(path_m)) << frame;
    EXPECT_GT(mode.variance_m2.minCoeff(), 0.0);
  }
  EXPECT_EQ(num_frames, 6);
}

TEST(AlternativeModesOf, TheWayThatIsSeenLessIsDoubtedLess) {
  const double even = ProbabilityAt(DoubtBest(Fork(kFrames)).alternative_modes, kForkFrame + 10);
  const double less = ProbabilityAt(DoubtBest(Fork(48)).alternative_modes, kForkFrame + 10);
  EXPECT_GT(even, 0.45);
  EXPECT_LT(less, 0.5 * even);
}

TEST(AlternativeModesOf, WhatWasSeenBehindThePathMakesItLikelier) {
  const double odds = [](double p) {
    return p / (1.0 - p);
  }(ProbabilityAt(DoubtBest(Fork(kFrames)).alternative_modes, kForkFrame + 10));
  const double less = [](double p) {
    return p / (1.0 - p);
  }(ProbabilityAt(DoubtBest(Fork(kFrames), 1).alternative_modes, kForkFrame + 10));
  EXPECT_LT(less, odds * std::exp(-1.5));
  EXPECT_EQ(ProbabilityAt(DoubtBest(Fork(kFrames), 10).alternative_modes, kForkFrame + 10), 0.0);
}

TEST(AlternativeModesOf, AFlightThatIsSeenInEveryFrameIsNotDoubted) {
  std::vector<Plot> plots;
  for (int i = 0; i < kFrames; ++i) {
    plots.push_back(MakePlot(kBeginNs + i * kPeriodNs, Straight(i * kPeriodS), std::log(1e-6)));
  }
  const Doubted found = DoubtBest(plots);
  EXPECT_EQ(found.path.size(), plots.size());
  for (int i = 0; i < kFrames; ++i) EXPECT_EQ(ProbabilityAt(found.alternative_modes, i), 0.0) << i;
}

// A beginning is an end for whom time runs backwards.
TEST(AlternativeModesOf, BeginningsAreDoubtedAsEndsAre) {
  const TrackerConfig config;
  const std::vector<Plot> plots = Fork(kFrames);
  const ScanSchedule scan_schedule = WatchOver(plots);
  const std::vector<Path> paths = FindPaths(plots, scan_schedule, config);
  ASSERT_FALSE(paths.empty());
  std::vector<Plot> mirrored;
  for (auto plot = plots.rbegin(); plot != plots.rend(); ++plot) {
    mirrored.push_back(TimeReversed(*plot));
  }
  Path back;
  for (auto i = paths.front().plots.rbegin(); i != paths.front().plots.rend(); ++i) {
    back.plots.push_back(static_cast<std::uint32_t>(plots.size()) - 1 - *i);
  }
  back.score = paths.front().score;
  const std::vector<AlternativeMode> ends =
      AlternativeModesOf(0, {paths.front()}, plots, scan_schedule, config, {});
  std::vector<AlternativeMode> begins =
      AlternativeModesOf(0, {back}, mirrored, TimeReversed(scan_schedule), config, {});
  std::reverse(begins.begin(), begins.end());
  ASSERT_EQ(begins.size(), ends.size());
  EXPECT_GT(ProbabilityAt(ends, kForkFrame + 10), 0.45);
  for (std::size_t i = 0; i < ends.size(); ++i) {
    EXPECT_EQ(TimeReversed(begins[i].time_ns), ends[i].time_ns);
    EXPECT_NEAR(begins[i].probability, ends[i].probability, 1e-9) << i;
    EXPECT_LT((begins[i].position_m - ends[i].position_m).norm(), 1e-6) << i;
  }
}

}  // namespace
}  // namespace unlidar
