#include "robust/collection/spots.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodS;
using testing::RecordingMaker;

constexpr int kFrames = 300;

// By one sensor at the origin, while the target is elsewhere but for [from_s, to_s].
double RateAt(const RecordingMaker& maker, const Eigen::Vector3f& point_m, double surroundings,
              double from_s = -2.0, double to_s = -1.0) {
  const Background background(maker.recording, BackgroundConfig());
  const std::vector<SensorView> views(1, {Eigen::Vector3f::Zero(), &background});
  std::vector<std::uint32_t> all;
  for (std::uint32_t i = 0; i < maker.recording.points_m.size(); ++i) all.push_back(i);
  const auto at_ns = [](double time_s) {
    return testing::kBeginNs + static_cast<TimeNs>(std::llround(time_s * 1e9));
  };
  return Spots(maker.recording, views, all)
      .RateOutside(0, point_m, at_ns(from_s), at_ns(to_s), surroundings);
}

TEST(Spots, AThinSurfaceHasTheRateOfItsOwnRoom) {
  RecordingMaker maker(1);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddBox({11.0, -1.0, 2.0}, {13.0, 1.0, 2.0}, 20);  // 5 a square metre
  }
  // At 12 m the neighbourhood is a block of three voxels of 2/3 of some 0.1 m.
  const double rate = RateAt(maker, {12.0F, 0.0F, 2.0F}, 5.0);
  EXPECT_GT(rate, 5.0 / 0.3);
  EXPECT_LT(rate, 5.0 / 0.15);
  EXPECT_LT(RateAt(maker, {12.0F, 0.0F, 2.5F}, 5.0), 1.0);
}

TEST(Spots, WhatIsSeenWhileTheTargetMayBeThereDoesNotCount) {
  RecordingMaker maker(2);
  for (int i = 0; i < kFrames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    if (i >= 100 && i < 150) maker.AddBlob({12.0, 0.0, 5.0}, 0.02, 3);
  }
  EXPECT_GT(RateAt(maker, {12.0F, 0.0F, 5.0F}, 0.5), 30.0);
  EXPECT_LT(RateAt(maker, {12.0F, 0.0F, 5.0F}, 1e-3, 10.0, 15.0), 1.1e-3);
}

}  // namespace
}  // namespace unlidar
