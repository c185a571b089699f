#include "scene/multi_station_plots.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/learned_occupancy.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodS;
using testing::MiddleS;
using testing::RecordingMaker;

constexpr int kFrames = 80;

// Ground, a wall, strays, a walker and a drone about the sensor; in coordinates so coarse that
// moving them is exact.
std::vector<Eigen::Vector3f> ReturnsOfFrame(int i) {
  RecordingMaker maker(static_cast<std::uint32_t>(i));
  maker.BeginFrame(i * kPeriodS);
  maker.AddGround(-1.5, 20.0, 400);
  maker.AddBox({18.0, -6.0, -1.5}, {18.05, 6.0, 5.0}, 100);
  maker.AddBox({-25.0, -25.0, 0.0}, {25.0, 25.0, 25.0}, maker.random.Poisson(2.0));
  const double y = 1.4 * (MiddleS(i) - 4.0);
  maker.AddBox({8.0, y, -1.5}, {8.4, y + 0.4, 0.25}, 20);
  maker.AddBlob({-9.0, 2.0 * (MiddleS(i) - 4.0), 6.0}, 0.1, 4);
  for (Eigen::Vector3f& point_m : maker.recording.points_m) {
    point_m = (point_m.array() * 1024.0F).round().matrix() / 1024.0F;
  }
  return maker.recording.points_m;
}

// Sensors at these origins that see the same about them, at the same times.
Recording SeenFrom(const std::vector<Eigen::Vector3f>& origins_m) {
  RecordingMaker maker(1, origins_m.size());
  for (std::uint32_t sensor = 0; sensor < origins_m.size(); ++sensor) {
    maker.recording.sensors[sensor].origin_m = origins_m[sensor];
  }
  for (int i = 0; i < kFrames; ++i) {
    for (std::uint32_t sensor = 0; sensor < origins_m.size(); ++sensor) {
      maker.BeginFrame(i * kPeriodS, sensor);
      for (const Eigen::Vector3f& point_m : ReturnsOfFrame(i)) {
        maker.Add((point_m + origins_m[sensor]).cast<double>());
      }
    }
  }
  return maker.recording;
}

// The plots of one sensor, and which returns of its frames belong to bodies.
struct Found {
  std::vector<Plot> plots;
  std::vector<char> are_bodies;
  std::size_t num_unexplained = 0;  // of all sensors
};

Found FoundBy(std::uint32_t sensor, const Recording& recording) {
  const RobustConfig config;
  MultiStationPlots all(recording, Stations(recording.sensors), config);
  all.EstimateClutter(std::vector<char>(all.plots().size(), 0));
  EXPECT_TRUE(std::is_sorted(
      all.plots().begin(), all.plots().end(),
      [](const Plot& a, const Plot& b) { return a.frame_time_ns < b.frame_time_ns; }));
  Found found;
  found.num_unexplained = all.num_unexplained();
  for (const Plot& plot : all.plots()) {
    if (plot.sensor == sensor) found.plots.push_back(plot);
  }
  for (const FrameInfo& frame : recording.frames) {
    if (frame.sensor != sensor) continue;
    found.are_bodies.insert(found.are_bodies.end(), all.are_bodies().begin() + frame.first_return,
                            all.are_bodies().begin() + frame.last_return);
  }
  return found;
}

TEST(MultiStationPlots, AStationElsewhereFindsTheSamePlotsThere) {
  const Eigen::Vector3f elsewhere_m(64.0F, -32.0F, 4.0F);
  const Recording of_one = SeenFrom({Eigen::Vector3f::Zero()});
  const Recording of_both = SeenFrom({Eigen::Vector3f::Zero(), elsewhere_m});
  const Found one = FoundBy(0, of_one);
  EXPECT_GT(one.plots.size(), static_cast<std::size_t>(kFrames));
  EXPECT_GT(std::count(one.are_bodies.begin(), one.are_bodies.end(), 1), 10 * kFrames);
  for (const std::uint32_t sensor : {0U, 1U}) {
    SCOPED_TRACE(sensor);
    const Found found = FoundBy(sensor, of_both);
    EXPECT_EQ(found.num_unexplained, 2 * one.num_unexplained);
    EXPECT_EQ(found.are_bodies, one.are_bodies);
    ASSERT_EQ(found.plots.size(), one.plots.size());
    for (std::size_t i = 0; i < found.plots.size(); ++i) {
      const Plot& plot = found.plots[i];
      const Plot& expected = one.plots[i];
      EXPECT_EQ(plot.frame, 2 * expected.frame + sensor);
      EXPECT_EQ(plot.frame_time_ns, expected.frame_time_ns);
      EXPECT_EQ(plot.ray_m, expected.position_m);
      EXPECT_EQ(plot.position_m,
                sensor == 0 ? plot.ray_m : (plot.ray_m + elsewhere_m.cast<double>()).eval());
      EXPECT_EQ(plot.log_clutter, expected.log_clutter);
      EXPECT_EQ(plot.is_floating, expected.is_floating);
      EXPECT_EQ(plot.num_below, expected.num_below);
      ASSERT_EQ(plot.returns.size(), expected.returns.size());
      for (std::size_t k = 0; k < plot.returns.size(); ++k) {
        EXPECT_EQ(plot.returns[k] - of_both.frames[plot.frame].first_return,
                  expected.returns[k] - of_one.frames[expected.frame].first_return);
      }
    }
  }
}

// What hovers throughout is structure by its occupancy, and a plot all the same; so is not what
// stands on the ground.
TEST(MultiStationPlots, WhatHoversThroughoutIsFloatingStructure) {
  RecordingMaker maker(2);
  constexpr int kHover = 1;
  constexpr int kPole = 2;
  for (int i = 0; i < 200; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddGround(-1.5, 20.0, 400);
    maker.AddBlob({8.0, 5.0, 8.0}, 0.1, 4, kHover);
    maker.AddBox({-8.1, 5.0, -1.5}, {-8.0, 5.1, 4.0}, 20, kPole);
  }
  const RobustConfig config;
  const MultiStationPlots found(maker.recording, Stations(maker.recording.sensors), config);
  EXPECT_EQ(found.plots().size(), 200U);
  for (const Plot& plot : found.plots()) {
    EXPECT_EQ(maker.labels[plot.returns.front()], kHover);
    EXPECT_TRUE(plot.is_floating);
    EXPECT_TRUE(plot.has_structure);
  }
}

TEST(MultiStationPlots, ThePlaceRateIsTheMeanOverTheReturns) {
  // Rain, denser near the sensor.
  RecordingMaker maker(3);
  for (int i = 0; i < 300; ++i) {
    maker.BeginFrame(i * kPeriodS);
    for (int k = maker.random.Poisson(60.0); k > 0; --k) {
      const double range_m = maker.random.Uniform(3.0, 12.0);
      maker.Add(range_m * maker.random.NormalVector(1.0).normalized());
    }
  }
  const Recording& recording = maker.recording;
  const RobustConfig config;
  const MultiStationPlots found(recording, Stations(recording.sensors), config);
  testing::LearnedOccupancy learned(recording);
  int num_rated = 0;
  for (const Plot& plot : found.plots()) {
    double mean = 0.0;
    for (const std::uint32_t i : plot.returns) {
      mean += static_cast<double>(learned.Judge(recording, i).place_rate) /
              static_cast<double>(plot.returns.size());
    }
    EXPECT_NEAR(plot.place_rate, mean, 1e-9);
    num_rated += mean > 0.0 ? 1 : 0;
  }
  EXPECT_GT(num_rated, 1000);
}

TEST(MultiStationPlots, OfNothingAreNone) {
  const RobustConfig config;
  RecordingMaker maker(1);
  for (int i = 0; i < 10; ++i) maker.BeginFrame(i * kPeriodS);
  const MultiStationPlots found(maker.recording, Stations(maker.recording.sensors), config);
  EXPECT_TRUE(found.plots().empty());
  EXPECT_EQ(found.num_unexplained(), 0U);
}

}  // namespace
}  // namespace unlidar
