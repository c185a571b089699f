// Long recordings, searched window by window.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "recording/pipeline.hpp"
#include "recording/robust.hpp"
#include "tests/draws.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::MiddleS;
using testing::RecordingMaker;
using testing::SecondsSinceBegin;

constexpr double kGround_m = -1.5;
constexpr int kFrames = 450;
constexpr double kLateS = 28.0;  // when the second drone comes

Eigen::Vector3d Circling(double time_s) {
  return {9.0 * std::cos(0.3 * time_s), 9.0 * std::sin(0.3 * time_s), 5.0 + std::sin(0.2 * time_s)};
}

Eigen::Vector3d Crossing(double time_s) { return {-15.0, 2.0 * (time_s - 36.0), 9.0}; }

// A yard with a house and strays, a drone that circles all the while, and one that comes late.
void AddFrame(int i, double time_s, RecordingMaker* maker) {
  maker->BeginFrame(time_s);
  maker->AddGround(kGround_m, 20.0, 400);
  maker->AddBox({18.0, -6.0, kGround_m}, {18.05, 6.0, 5.0}, 150);
  maker->AddBox({-25.0, -25.0, 0.0}, {25.0, 25.0, 25.0}, maker->random.Poisson(1.0));
  maker->AddBlob(Circling(MiddleS(i)), 0.1, maker->random.Poisson(4.0));
  if (MiddleS(i) > kLateS) maker->AddBlob(Crossing(MiddleS(i)), 0.1, maker->random.Poisson(4.0));
}

const Recording& Long() {
  static const Recording recording = [] {
    RecordingMaker maker(1);
    for (int i = 0; i < kFrames; ++i) AddFrame(i, i * kPeriodS, &maker);
    return maker.recording;
  }();
  return recording;
}

Config WindowsOf(double window_s, double margin_s) {
  Config config;
  config.robust.window_s = window_s;
  config.robust.window_margin_s = margin_s;
  return config;
}

Config OneWindow() { return WindowsOf(90.0, 0.0); }

std::vector<TrajectoryRow> Rows(const PipelineResult& result, std::size_t track) {
  std::vector<TrajectoryRow> rows;
  const RowStream next = RowsOf(result, result.tracks[track]);
  while (const auto row = next()) rows.push_back(*row);
  return rows;
}

TEST(Windows, TracksAreThoseOfTheWholeWhateverTheWindow) {
  const PipelineResult whole = TracksOf(Long(), FirstSensorStamps(), OneWindow());
  ASSERT_EQ(whole.tracks.size(), 2U);
  constexpr std::array<double, 3> kWindows_s = {10.0, 17.0, 25.0};
  for (std::size_t k = 0; k < testing::Draws(kWindows_s.size()); ++k) {
    const double window_s = kWindows_s.at(k);
    SCOPED_TRACE(window_s);
    const PipelineResult parts = TracksOf(Long(), FirstSensorStamps(), WindowsOf(window_s, 4.0));
    ASSERT_EQ(parts.tracks.size(), 2U);
    for (std::size_t track = 0; track < 2; ++track) {
      const std::vector<TrajectoryRow> expected = Rows(whole, track);
      const std::vector<TrajectoryRow> rows = Rows(parts, track);
      EXPECT_NEAR(static_cast<double>(rows.size()), static_cast<double>(expected.size()), 2.0);
      for (const TrajectoryRow& row : rows) {
        const double time_s = SecondsSinceBegin(row.time_ns);
        const Eigen::Vector3d truth_m = track == 0 ? Circling(time_s) : Crossing(time_s);
        EXPECT_LT((row.position_m - truth_m).norm(), 0.5) << time_s;
      }
    }
  }
}

TEST(Windows, ReturnsAreThoseOfTheRecordingAndOneTracksEach) {
  const PipelineResult result = TracksOf(Long(), FirstSensorStamps(), WindowsOf(10.0, 4.0));
  const Recording& kept = result.recording;
  ASSERT_EQ(kept.frames.size(), Long().frames.size());
  std::set<std::uint32_t> taken;
  for (const FittedTrack& track : result.tracks) {
    for (const std::uint32_t i : track.returns) EXPECT_TRUE(taken.insert(i).second);
    int support = 0;
    for (const TrajectoryRow& row : Rows(result, static_cast<std::size_t>(track.id()))) {
      support += row.support;
    }
    EXPECT_EQ(support, static_cast<int>(track.returns.size()));
  }
  EXPECT_EQ(taken.size(), kept.points_m.size());  // nothing else is kept
  for (std::size_t f = 0; f < kept.frames.size(); ++f) {
    const FrameInfo& frame = kept.frames[f];
    const FrameInfo& source = Long().frames[f];
    EXPECT_EQ(frame.stamp_ns, source.stamp_ns);
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      const auto first = Long().points_m.begin() + source.first_return;
      const auto last = Long().points_m.begin() + source.last_return;
      EXPECT_NE(std::find(first, last, kept.points_m[i]), last);
    }
  }
}

TEST(Windows, ARecordingThatIsNoLongerThanOneIsSearchedAsAWhole) {
  const Config config = WindowsOf(kFrames * kPeriodS, 4.0);
  const RobustResult whole = FindTargetsRobust(Long(), config.robust, config.trajectory);
  const PipelineResult one = TracksOf(Long(), FirstSensorStamps(), config);
  ASSERT_EQ(one.tracks.size(), whole.targets.size());
  for (const Target& target : whole.targets) {
    const auto is_same = [&](const FittedTrack& track) { return track.score == target.score; };
    const auto track = std::find_if(one.tracks.begin(), one.tracks.end(), is_same);
    ASSERT_NE(track, one.tracks.end());
    EXPECT_EQ(track->returns.size(), target.returns.size());
    EXPECT_EQ(track->row_source.trajectory.control_points_m, target.trajectory.control_points_m);
  }
}

// What is held of the frames at any time is a window with its margins.
TEST(Windows, HoldNoMoreThanAWindowWithItsMargins) {
  const Config config = WindowsOf(10.0, 4.0);
  std::size_t most = 0;
  std::size_t next = 0;
  const FrameFeed feed = [&](TimeNs until_ns, Recording* part) {
    part->sensors = Long().sensors;
    for (; next < Long().frames.size() && Long().frames[next].stamp_ns < until_ns; ++next) {
      FrameInfo frame = Long().frames[next];
      frame.first_return = frame.last_return = static_cast<std::uint32_t>(part->points_m.size());
      part->frames.push_back(frame);
    }
    most = std::max(most, part->frames.size());
    return next < Long().frames.size() ? Long().frames[next].stamp_ns
                                       : std::numeric_limits<TimeNs>::max();
  };
  Recording kept;
  FindTargetsInWindows(feed, kBeginNs, Long().frames.back().stamp_ns, config.robust,
                       config.trajectory, nullptr, &kept);
  EXPECT_EQ(kept.frames.size(), Long().frames.size());
  EXPECT_LE(most, static_cast<std::size_t>((10.0 + 2 * 4.0) / kPeriodS) + 2);
}

TEST(Windows, APauseOfYearsTakesNoWindows) {
  RecordingMaker maker(1);
  for (int i = 0; i < 130; ++i) AddFrame(i, i * kPeriodS, &maker);
  const double pause_s = 3e8;
  for (int i = 130; i < 260; ++i) AddFrame(i, pause_s + i * kPeriodS, &maker);
  const PipelineResult result =
      TracksOf(maker.recording, FirstSensorStamps(), WindowsOf(10.0, 4.0));
  EXPECT_EQ(result.recording.frames.size(), maker.recording.frames.size());
  ASSERT_EQ(result.tracks.size(), 2U);
  for (const FittedTrack& track : result.tracks) EXPECT_GT(track.num_rows, 120U);
}

}  // namespace
}  // namespace unlidar
