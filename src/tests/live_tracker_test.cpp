#include "live/live_tracker.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodNs;
using testing::Random;

// It costs as much as the whole search, and its tracks are followed without that.
TEST(LiveTracker, TheFirstLookEndsWhenTheWholeSearchHasComeAsFar) {
  const Config config;
  LiveTracker tracker(config, FirstSensorStamps(), [](const EngineEvent&) {});
  SensorInfo info;
  info.frame_period_ns = kPeriodNs;
  tracker.SetSensor(0, info);
  Random random(7);
  for (int i = 0; i < 60; ++i) {
    LoadedFrame frame;
    frame.info = testing::FrameAt(i);
    for (int k = 0; k < 50; ++k) {
      frame.points_m.push_back(random.NormalVector(10.0).cast<float>());
      frame.times_ns.push_back(frame.info.middle_ns());
    }
    tracker.Take(&frame);
    EXPECT_TRUE(tracker.is_warm() || tracker.looks_ahead());
  }
  EXPECT_TRUE(tracker.is_warm());
  EXPECT_FALSE(tracker.looks_ahead());
}

}  // namespace
}  // namespace unlidar
