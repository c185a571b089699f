#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include "live/track_follower.hpp"

namespace unlidar {
namespace {

constexpr double kPeriodS = 0.1;
constexpr TimeNs kPeriodNs = 100'000'000;
constexpr int kFrames = 40;

LivePlot PlotAt(int i, const Eigen::Vector3d& position_m) {
  LivePlot seen;
  seen.plot.frame = static_cast<std::uint32_t>(i);
  seen.plot.time_ns = seen.plot.frame_time_ns = i * kPeriodNs;
  seen.plot.position_m = seen.plot.ray_m = position_m;
  seen.plot.variance_m2 = 0.02;
  seen.plot.lowest_m = 10.0;
  seen.plot.log_clutter = seen.log_surrounding_clutter = -10.0;
  seen.plot.num_returns = 2;
  seen.time_s = i * kPeriodS;
  return seen;
}

FrameTime MomentAt(int i) { return {i * kPeriodS, {static_cast<std::uint32_t>(i)}}; }

LivePlot DroneAt(int i) { return PlotAt(i, {15.0, -10.0 + 0.4 * i, 8.0}); }

// A flight that was found from the 20th frame on; every frame shows a stray, too.
class PastOfTest : public ::testing::Test {
 protected:
  PastOfTest() : scan_schedule_{{ScanSchedule::Sensor()}} {
    scan_schedule_.sensors[0].frame_s = kPeriodS;
    models_.emplace_back(3.0, scan_schedule_, config_.robust.tracker);
    for (int i = 0; i < kFrames; ++i) {
      seen_.push_back(PlotAt(i, {40.0 * std::sin(i * i), 40.0 * std::cos(i * i), 12.0}));
      seen_.push_back(DroneAt(i));
      moments_.Add(static_cast<std::uint32_t>(i), MomentAt(i));
    }
    are_free_.assign(seen_.size(), 1);
    for (int i = kFrames / 2; i < kFrames; ++i) {
      flight_.plots.push_back(DroneAt(i));
      flight_.frame_times.push_back(MomentAt(i));
    }
  }

  std::vector<std::uint32_t> PastPlots() const {
    RecentPlots seen;
    for (const LivePlot& one : seen_) seen.push_back(one);
    return ExtendBackwards(flight_, seen, are_free_, moments_, num_frames_, models_,
                           config_.robust);
  }

  // Numbers of the frames whose plot of the drone is in the past of the flight, and nothing else.
  std::vector<int> Past() const {
    std::vector<int> frames;
    for (const std::uint32_t i : PastPlots()) {
      EXPECT_EQ(i % 2, 1U) << "a stray";
      frames.push_back(static_cast<int>(i / 2));
    }
    return frames;
  }

  static std::vector<int> From(int first) {
    std::vector<int> frames(static_cast<std::size_t>(kFrames / 2 - first));
    std::iota(frames.begin(), frames.end(), first);
    return frames;
  }

  Config config_;
  ScanSchedule scan_schedule_;
  std::vector<TrackModel> models_;
  std::vector<LivePlot> seen_;
  std::vector<char> are_free_;
  RecentFrameTimes moments_;
  std::vector<std::uint32_t> num_frames_ = {kFrames};
  Flight flight_;
};

TEST_F(PastOfTest, AFlightIsFollowedBackToItsFirstPlot) { EXPECT_EQ(Past(), From(0)); }

// At the first plots it was not known of them.
TEST_F(PastOfTest, SensorsThatAreHeardLaterChangeNothing) {
  scan_schedule_.sensors.resize(65, scan_schedule_.sensors[0]);
  models_.assign(1, TrackModel(3.0, scan_schedule_, config_.robust.tracker));
  num_frames_.resize(65, 0);
  EXPECT_EQ(Past(), From(0));
}

TEST_F(PastOfTest, WhatAnotherTrackHasIsNotItsOwn) {
  for (std::size_t i = 1; i < 20; i += 2) are_free_[i] = 0;
  EXPECT_EQ(Past(), From(10));
}

// It takes off: what rises so high is no person, and was none below.
TEST_F(PastOfTest, WhatIsNearTheGroundIsItsOwn) {
  for (std::size_t i = 1; i < 20; i += 2) seen_[i].plot.lowest_m = 0.5;
  EXPECT_EQ(Past(), From(0));
}

// In a pause many ways among strays score alike; before it one of them goes on.
TEST_F(PastOfTest, AcrossAPauseAmongStraysItsFirstPlotsAreItsOwn) {
  constexpr int kStrays = 20;
  constexpr int kPauseBegin = 8;
  constexpr int kEvery = 3;  // frames per sighting
  flight_ = Flight();
  for (int i = kFrames / 2; i < kFrames; i += kEvery) {
    flight_.plots.push_back(DroneAt(i));
    flight_.frame_times.push_back(MomentAt(i));
  }
  seen_.clear();
  std::mt19937 random(3);
  std::normal_distribution<double> offset_m(0.0, 4.0);
  std::vector<std::uint32_t> expected;
  for (int i = 0; i < kFrames / 2; ++i) {
    if (i < kPauseBegin) {
      expected.push_back(static_cast<std::uint32_t>(seen_.size()));
      seen_.push_back(DroneAt(i));
      continue;
    }
    for (int k = 0; k < kStrays; ++k) {
      const Eigen::Vector3d apart_m(offset_m(random), offset_m(random), offset_m(random));
      seen_.push_back(PlotAt(i, DroneAt(i).plot.position_m + apart_m));
      seen_.back().plot.log_clutter = seen_.back().log_surrounding_clutter = -5.0;
    }
  }
  are_free_.assign(seen_.size(), 1);
  EXPECT_EQ(PastPlots(), expected);
}

TEST_F(PastOfTest, WhatWasClutterByAllThatIsKnownStaysClutter) {
  for (std::size_t i = 1; i < 20; i += 2) seen_[i].plot.log_clutter = 3.0;
  EXPECT_EQ(Past(), From(10));
}

// A target begins somewhere: chains of strays before it are less likely than clutter.
TEST_F(PastOfTest, StraysBeforeItsBeginAreNotItsOwn) {
  for (int i = 0; i < kFrames / 2; ++i) {
    const auto k = static_cast<std::size_t>(2 * i);
    const Eigen::Vector3d offset_m(std::sin(7 * i), std::sin(11 * i), std::sin(13 * i));
    seen_[k] = PlotAt(i, DroneAt(i).plot.position_m + 1.2 * offset_m);
    seen_[k].plot.log_clutter = seen_[k].log_surrounding_clutter = -2.0;
    are_free_[k + 1] = 0;
  }
  EXPECT_EQ(Past(), From(kFrames / 2));
}

// What floats did so before that was known: its own plots are no clutter of its place.
TEST_F(PastOfTest, WhatFloatsFloatedBefore) {
  for (int i = 0; i < kFrames; ++i) {
    seen_[static_cast<std::size_t>(2 * i + 1)] = PlotAt(i, {15.0, 5.0, 8.0});
    if (i < kFrames / 2) {
      seen_[static_cast<std::size_t>(2 * i + 1)].plot.log_clutter = 3.0;
    } else {
      flight_.plots[static_cast<std::size_t>(i - kFrames / 2)] = PlotAt(i, {15.0, 5.0, 8.0});
      flight_.plots[static_cast<std::size_t>(i - kFrames / 2)].plot.is_floating = true;
    }
  }
  EXPECT_EQ(Past(), From(0));
  for (LivePlot& seen : flight_.plots) seen.plot.is_floating = false;
  EXPECT_EQ(Past(), From(kFrames / 2));
}

}  // namespace
}  // namespace unlidar
