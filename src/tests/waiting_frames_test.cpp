#include "live/waiting_frames.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <vector>

#include "live/live_engine.hpp"

namespace unlidar {
namespace {

void Add(WaitingFrames* waiting, std::uint32_t sensor, TimeNs time_ns, std::size_t points = 0) {
  LoadedFrame& frame = waiting->Next();
  frame.info.sensor = sensor;
  frame.file.stamp_ns = time_ns;
  frame.points_m.assign(points, Eigen::Vector3f::Zero());
  waiting->Add(time_ns);
}

TEST(WaitingFrames, GoInTheOrderOfTheirTimes) {
  WaitingFrames waiting;
  for (const TimeNs time_ns : {5, 1, 4, 2, 3}) Add(&waiting, 0, time_ns);
  for (TimeNs time_ns = 1; time_ns <= 5; ++time_ns) {
    EXPECT_EQ(waiting.earliest_ns(), time_ns);
    EXPECT_EQ(waiting.TakeEarliest()->file.stamp_ns, time_ns);
  }
  EXPECT_TRUE(waiting.empty());
  EXPECT_FALSE(waiting.TakeOverflow());
}

TEST(WaitingFrames, WhoSendsTooManyLosesHisOwnNewestAndNobodyElseAny) {
  WaitingFrames waiting;
  for (TimeNs k = 0; k < 100; ++k) Add(&waiting, 1, 1000 * k);
  std::size_t dropped = 0;
  for (TimeNs k = 0; k < static_cast<TimeNs>(WaitingFrames::kMaxFrames); ++k) {
    Add(&waiting, 0, k);
    while (const auto gone = waiting.TakeOverflow()) {
      ++dropped;
      EXPECT_EQ(gone->info.sensor, 0U);
      EXPECT_EQ(gone->file.stamp_ns, k);
    }
  }
  EXPECT_EQ(dropped, 100U);
  const std::vector<LoadedFrame> left = waiting.TakeAll();
  EXPECT_EQ(left.size(), WaitingFrames::kMaxFrames);
  EXPECT_TRUE(std::is_sorted(left.begin(), left.end(), [](const auto& a, const auto& b) {
    return a.file.stamp_ns < b.file.stamp_ns;
  }));
}

TEST(WaitingFrames, AreBoundedInBytesWithTheMemoryOfThoseThatHaveGone) {
  constexpr std::size_t kPoints = std::size_t{1} << 21;  // 24 MB
  constexpr std::size_t kMost = WaitingFrames::kMaxBytes / (kPoints * sizeof(Eigen::Vector3f));
  WaitingFrames waiting;
  std::size_t dropped = 0;
  for (TimeNs k = 0; k < 12; ++k) {
    Add(&waiting, 0, k, kPoints);
    while (waiting.TakeOverflow()) ++dropped;
  }
  EXPECT_EQ(dropped, 12 - kMost);
  while (!waiting.empty()) waiting.TakeEarliest();
  Add(&waiting, 0, 100, kPoints);  // into memory that is there
  EXPECT_FALSE(waiting.TakeOverflow());
}

TEST(WaitingFrames, OneFrameIsKeptHoweverLargeItIs) {
  WaitingFrames waiting;
  Add(&waiting, 0, 1, WaitingFrames::kMaxBytes / sizeof(Eigen::Vector3f) + 1);
  EXPECT_FALSE(waiting.TakeOverflow());
}

// Stamps that stand still let none of them go.
TEST(LiveEngine, FramesOfOneInstantAreBoundedAndEachIsCounted) {
  LiveEngine engine(
      Config(), {"a"}, FirstSensorStamps{}, [](const EngineEvent&) {}, nullptr);
  constexpr std::uint64_t kFrames = WaitingFrames::kMaxFrames + 100;
  for (std::uint64_t k = 0; k < kFrames; ++k) {
    CloudFrame frame;
    frame.stamp_ns = 1'700'000'000'000'000'000 + static_cast<TimeNs>(k);
    frame.name = "frame";
    engine.Add(std::move(frame));
  }
  EXPECT_EQ(engine.overflow_frames().count, kFrames - WaitingFrames::kMaxFrames);
  EXPECT_EQ(engine.counts().frames, WaitingFrames::kMaxFrames);
}

}  // namespace
}  // namespace unlidar
