// Of which frames the scene is taken.
#include "scene/scene_frames.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace unlidar {
namespace {

constexpr TimeNs kSecond_ns = 1'000'000'000;

// Two sensors that take turns, three returns a frame.
Recording Of(int num_frames, TimeNs period_ns) {
  Recording recording;
  for (int i = 0; i < num_frames; ++i) {
    FrameInfo frame;
    frame.stamp_ns = i * period_ns;
    frame.sensor = static_cast<std::uint32_t>(i % 2);
    frame.first_return = static_cast<std::uint32_t>(3 * i);
    frame.last_return = frame.first_return + 3;
    recording.frames.push_back(frame);
  }
  return recording;
}

TEST(SceneFrames, AreAllOfAShortRecording) {
  EXPECT_TRUE(SceneFrames({}).empty());
  EXPECT_EQ(SceneFrames(Of(1, 0)).size(), 1U);
  EXPECT_EQ(SceneFrames(Of(1800, kSecond_ns / 20)).size(), 1800U);
  EXPECT_EQ(SceneFrames(Of(20, 3600 * kSecond_ns)).size(), 20U);  // however long it pauses
}

TEST(SceneFrames, OfALongOneAreAtMostAMinuteAndAHalfOfBothSensors) {
  for (const int seconds : {91, 130, 179, 200, 1000}) {
    const std::vector<FrameInfo> frames = SceneFrames(Of(20 * seconds, kSecond_ns / 20));
    EXPECT_LE(frames.size(), std::size_t{20 * 90}) << seconds;
    EXPECT_GE(frames.size(), std::size_t{20 * 45}) << seconds;
    std::array<std::size_t, 2> of_sensor = {0, 0};
    for (const FrameInfo& frame : frames) ++of_sensor.at(frame.sensor);
    EXPECT_EQ(of_sensor[0], of_sensor[1]) << seconds;
  }
}

TEST(SceneFrames, ReturnsAreThoseOfTheFrames) {
  const Recording recording = Of(2000, kSecond_ns / 20);
  std::vector<std::uint32_t> some;  // every other return
  for (std::uint32_t i = 0; i < 6000; i += 2) some.push_back(i);
  EXPECT_EQ(ReturnsOf(recording.frames, some), some);
  const std::vector<FrameInfo> frames = SceneFrames(recording);
  std::vector<std::uint32_t> expected;
  for (const FrameInfo& frame : frames) {
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      if (i % 2 == 0) expected.push_back(i);
    }
  }
  EXPECT_EQ(ReturnsOf(frames, some), expected);
}

}  // namespace
}  // namespace unlidar
