#include "scene/stations.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace unlidar {
namespace {

std::vector<SensorInfo> SensorsAt(const std::vector<Eigen::Vector3f>& origins_m) {
  std::vector<SensorInfo> sensors(origins_m.size());
  for (std::size_t i = 0; i < sensors.size(); ++i) sensors[i].origin_m = origins_m[i];
  return sensors;
}

TEST(Stations, SensorsNearTheCommonOriginSeeFromThere) {
  const Stations stations(SensorsAt({{0.2F, 0, -0.1F}, {-1.5F, 0.5F, 1.0F}, {0, 0, 0}}));
  ASSERT_EQ(stations.size(), 1U);
  EXPECT_EQ(stations.ViewpointM(0), Eigen::Vector3f(0, 0, 0));
  for (const std::uint32_t sensor : {0U, 1U, 2U}) EXPECT_EQ(stations.StationOf(sensor), 0U);
}

TEST(Stations, WhatStandsMetresApartIsAnother) {
  const Stations stations(SensorsAt({{60, 8, 1}, {0, 0, 0}, {60, 9, 1}, {60, 8, 4}}));
  ASSERT_EQ(stations.size(), 3U);
  EXPECT_EQ(stations.ViewpointM(0), Eigen::Vector3f(60, 8, 1));
  EXPECT_EQ(stations.ViewpointM(1), Eigen::Vector3f(0, 0, 0));
  EXPECT_EQ(stations.ViewpointM(2), Eigen::Vector3f(60, 8, 4));
  EXPECT_EQ(stations.StationOf(0), 0U);
  EXPECT_EQ(stations.StationOf(1), 1U);
  EXPECT_EQ(stations.StationOf(2), 0U);
  EXPECT_EQ(stations.StationOf(3), 2U);
}

TEST(RecordingOf, AStationHasItsOwnFramesAboutItsViewpoint) {
  Recording whole;
  whole.sensors = SensorsAt({{0, 0, 0}, {60, 8, 1}});
  for (std::uint32_t f = 0; f < 4; ++f) {
    FrameInfo frame;
    frame.sensor = f % 2;
    frame.first_return = static_cast<std::uint32_t>(whole.points_m.size());
    for (std::uint32_t i = 0; i <= f; ++i) {
      whole.points_m.push_back(Eigen::Vector3f::Constant(static_cast<float>(10 * f + i)));
      whole.times_ns.push_back(100 * f + i);
    }
    frame.last_return = static_cast<std::uint32_t>(whole.points_m.size());
    whole.frames.push_back(frame);
  }
  const StationRecording part = RecordingOf(whole, Stations(whole.sensors), 1);
  EXPECT_EQ(part.frames, (std::vector<std::uint32_t>{1, 3}));
  ASSERT_EQ(part.recording.frames.size(), 2U);
  EXPECT_EQ(part.recording.sensors.size(), 2U);
  for (std::size_t k = 0; k < 2; ++k) {
    const FrameInfo& own = part.recording.frames[k];
    const FrameInfo& frame = whole.frames[part.frames[k]];
    ASSERT_EQ(own.last_return - own.first_return, frame.last_return - frame.first_return);
    for (std::uint32_t i = 0; i < own.last_return - own.first_return; ++i) {
      EXPECT_EQ(part.recording.points_m[own.first_return + i],
                whole.points_m[frame.first_return + i] - Eigen::Vector3f(60, 8, 1));
      EXPECT_EQ(part.recording.times_ns[own.first_return + i],
                whole.times_ns[frame.first_return + i]);
    }
  }
}

}  // namespace
}  // namespace unlidar
