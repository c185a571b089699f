#include "live/live_instants.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodS;
using testing::RecordingMaker;

constexpr TimeNs kSilentNs = 500'000'000;
constexpr TimeNs kEndless = std::numeric_limits<TimeNs>::max();

// Frames of two sensors in turn.
Recording TwoSensors() {
  RecordingMaker maker(1, 2);
  for (int i = 0; i < 40; ++i) {
    maker.BeginFrame(i * kPeriodS, static_cast<std::uint32_t>(i % 2));
    maker.Add({1, 0, 0});
  }
  return maker.recording;
}

std::vector<OutputTimes> AllKinds() {
  return {FirstSensorStamps{}, Rate{7'300'000'000},
          std::vector<TimeNs>{kBeginNs - 5, kBeginNs, kBeginNs + 123'456'789,
                              kBeginNs + 2'000'000'000, kBeginNs + 2'000'000'001}};
}

std::vector<TimeNs> Between(const LiveInstants& instants, TimeNs after_ns, TimeNs until_ns) {
  OutputInstants found;
  instants.GetBetween(after_ns, until_ns, &found);
  std::vector<TimeNs> list;
  for (std::size_t k = 0; k < found.size(); ++k) list.push_back(found[k]);
  return list;
}

LiveInstants InstantsOf(const OutputTimes& times, const Recording& recording) {
  LiveInstants instants(times, kSilentNs);
  for (const FrameInfo& frame : recording.frames) instants.Add(frame);
  return instants;
}

TEST(LiveInstants, AreThoseOfTheRecording) {
  const Recording recording = TwoSensors();
  for (const OutputTimes& times : AllKinds()) {
    const OutputInstants all = ResolveOutputTimes(times, recording);
    std::vector<TimeNs> expected;
    for (std::size_t k = 0; k < all.size(); ++k) expected.push_back(all[k]);
    EXPECT_EQ(Between(InstantsOf(times, recording), -kEndless, kEndless), expected);
  }
}

TEST(LiveInstants, AreThoseOfTheNextSensorWhileTheFirstIsSilent) {
  std::vector<TimeNs> expected;
  LiveInstants instants(FirstSensorStamps{}, kSilentNs);
  for (const FrameInfo& frame : TwoSensors().frames) {
    const TimeNs since_ns = frame.stamp_ns - kBeginNs;
    const bool is_unplugged = since_ns >= 1'000'000'000 && since_ns < 3'000'000'000;
    if (frame.sensor == 0 && is_unplugged) continue;
    instants.Add(frame);
    const bool is_told = is_unplugged && since_ns > 900'000'000 + kSilentNs;
    if (frame.sensor == (is_told ? 1 : 0)) expected.push_back(frame.stamp_ns);
  }
  EXPECT_EQ(Between(instants, -kEndless, kEndless), expected);
}

TEST(LiveInstants, APauseOfDecadesHasFewAndTheyAreThoseOfTheRate) {
  constexpr TimeNs kPause_ns = 20LL * 365 * 86'400 * 1'000'000'000;
  const Rate rate{7'300'000'000};
  FrameInfo frame;
  frame.begin_ns = kBeginNs;
  frame.end_ns = kBeginNs + 100'000'000;
  LiveInstants instants(OutputTimes(rate), kSilentNs);
  instants.Add(frame);
  frame.begin_ns += kPause_ns;
  frame.end_ns += kPause_ns;
  instants.Add(frame);
  const OutputInstants all(rate, kBeginNs, kBeginNs);
  const auto first_k = static_cast<std::size_t>((20LL * 365 * 86'400 - 1200) * 73 / 10);
  std::vector<TimeNs> expected;
  for (std::size_t k = first_k; all[k] <= frame.end_ns; ++k) expected.push_back(all[k]);
  EXPECT_EQ(Between(instants, kBeginNs + 200'000'000, kEndless), expected);
}

TEST(LiveInstants, NoneIsLaterThanTheFramesSoFar) {
  const Recording recording = TwoSensors();
  for (const OutputTimes& times : AllKinds()) {
    LiveInstants instants(times, kSilentNs);
    for (const FrameInfo& frame : recording.frames) {
      instants.Add(frame);
      EXPECT_TRUE(Between(instants, frame.end_ns, kEndless).empty());
    }
  }
}

TEST(LiveInstants, AfterOneUpToAnotherLeaveOutTheFirstAlone) {
  const LiveInstants instants = InstantsOf(FirstSensorStamps{}, TwoSensors());
  const std::vector<TimeNs> all = Between(instants, -kEndless, kEndless);
  EXPECT_EQ(Between(instants, all[3], all[6]), (std::vector<TimeNs>{all[4], all[5], all[6]}));
  EXPECT_TRUE(Between(instants, all[3], all[3]).empty());
}

TEST(LiveInstants, ShareOutAllStampsWithoutGapOrOverlap) {
  for (const OutputTimes& times : AllKinds()) {
    const LiveInstants instants = InstantsOf(times, TwoSensors());
    const std::vector<TimeNs> all = Between(instants, -kEndless, kEndless);
    ASSERT_GT(all.size(), 2U);
    EXPECT_EQ(instants.Around(all.front()).begin_ns, all.front());
    for (std::size_t k = 0; k < all.size(); ++k) {
      const TimeInterval around = instants.Around(all[k]);
      EXPECT_LE(around.begin_ns, all[k]);
      EXPECT_GE(around.end_ns, all[k]);
      if (k == 0) continue;
      const TimeNs gap_ns = around.begin_ns - instants.Around(all[k - 1]).end_ns;
      EXPECT_TRUE(gap_ns == 0 || gap_ns == 1) << gap_ns;  // the middle of an odd gap
    }
  }
}

TEST(LiveInstants, OfThoseBeforeTheOldestOnlyTheLastIsKept) {
  LiveInstants instants = InstantsOf(FirstSensorStamps{}, TwoSensors());
  const std::vector<TimeNs> all = Between(instants, -kEndless, kEndless);
  const TimeInterval around = instants.Around(all[8]);
  instants.Forget(all[8]);
  EXPECT_EQ(Between(instants, -kEndless, kEndless),
            std::vector<TimeNs>(all.begin() + 7, all.end()));
  EXPECT_EQ(instants.Around(all[8]).begin_ns, around.begin_ns);
  EXPECT_EQ(instants.Around(all[8]).end_ns, around.end_ns);
}

}  // namespace
}  // namespace unlidar
