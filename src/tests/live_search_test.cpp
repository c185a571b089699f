#include "live/live_search.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodNs;
using testing::Random;

constexpr double kRangeM = 57.0;

// When the first flight began that is found among plots, one a frame, of which none floats; none
// if none is.
template <class PlaceAt>
std::optional<double> BeginOfFlight(int num_frames, const PlaceAt& place_at) {
  const Config config;
  LiveSearch search(config);
  SensorInfo info;
  info.frame_period_ns = kPeriodNs;
  search.SetSensor(0, info, Eigen::Vector3f::Zero());
  Random random(5);
  for (int i = 0; i < num_frames; ++i) {
    SceneFrame frame;
    frame.info = testing::FrameAt(i);
    frame.time_s = testing::MiddleS(i);
    frame.observed_s = 60.0;
    frame.is_searched = true;
    LivePlot seen;
    seen.time_s = frame.time_s;
    seen.stamp_ns = frame.info.stamp_ns;
    Plot& plot = seen.plot;
    plot.frame = static_cast<std::uint32_t>(i);
    plot.time_ns = plot.frame_time_ns = frame.info.middle_ns();
    plot.position_m = plot.ray_m = place_at(frame.time_s) + random.NormalVector(0.15);
    plot.variance_m2 = 0.03;
    plot.lowest_m = 50.0;
    plot.log_clutter = -3.0;
    plot.num_returns = 2;
    frame.plots.push_back(seen);
    search.Begin(frame);
    for (const Path& path : search.Extend(frame, {1})) {
      const Flight* const flight = search.FlightOf(path);
      if (flight != nullptr) return flight->plots.front().time_s;
    }
  }
  return std::nullopt;
}

// What creeps, goes on a little faster and stands is one thing, although neither its begin nor its
// end moves far.
TEST(LiveSearch, WhatDriftsDoesNotStandWhereItBegan) {
  const auto begin_s = BeginOfFlight(150, [](double time_s) {
    constexpr double kFasterS = 6.0;
    const double crept_m = 0.3 * std::min(time_s, kFasterS);
    return Eigen::Vector3d(crept_m + std::clamp(time_s - kFasterS, 0.0, 2.2), 0.0, kRangeM);
  });
  ASSERT_TRUE(begin_s);
  EXPECT_LT(*begin_s, 1.0);
}

TEST(LiveSearch, WhatFliesOffFromATwigIsNotTheTwig) {
  constexpr double kOffS = 6.0;
  const auto begin_s = BeginOfFlight(150, [](double time_s) {
    return Eigen::Vector3d(std::max(0.0, 3.0 * (time_s - kOffS)), 0.0, kRangeM);
  });
  ASSERT_TRUE(begin_s);
  EXPECT_GT(*begin_s, kOffS);
}

// What the first flight of 3 m/s must reach that is found while clutter is hardly known, beside
// three plots a frame that lie about a place which moves along at this distance.
double LeastScoreBeside(double distance_m) {
  const Config config;
  LiveSearch search(config);
  SensorInfo info;
  info.frame_period_ns = kPeriodNs;
  search.SetSensor(0, info, Eigen::Vector3f::Zero());
  Random random(6);
  constexpr int kNumOthers = 3;
  for (int i = 0; i < 30; ++i) {
    SceneFrame frame;
    frame.info = testing::FrameAt(i);
    frame.time_s = testing::MiddleS(i);
    frame.observed_s = 3.0;
    frame.is_searched = true;
    const Eigen::Vector3d at_m(3.0 * frame.time_s, 0.0, 20.0);
    for (int k = 0; k <= kNumOthers; ++k) {
      LivePlot seen;
      seen.time_s = frame.time_s;
      seen.stamp_ns = frame.info.stamp_ns;
      Plot& plot = seen.plot;
      plot.frame = static_cast<std::uint32_t>(i);
      plot.time_ns = plot.frame_time_ns = frame.info.middle_ns();
      plot.position_m = at_m;
      if (k > 0)
        plot.position_m += Eigen::Vector3d(0.0, distance_m, 0.0) + random.NormalVector(0.8);
      plot.ray_m = plot.position_m;
      plot.variance_m2 = 0.002;
      plot.lowest_m = 20.0;
      plot.log_clutter = k == 0 ? -6.0 : 0.0;
      plot.num_returns = 2;
      frame.plots.push_back(seen);
    }
    search.Begin(frame);
    for (const Path& path : search.Extend(frame, {1, 1, 1, 1})) {
      if (search.FlightOf(path) != nullptr) return search.ScoreThresholdOf(path);
    }
  }
  ADD_FAILURE() << "no flight";
  return 0.0;
}

TEST(LiveSearch, WhatHasOthersAboutItMustBeSurerAtFirst) {
  EXPECT_GT(LeastScoreBeside(0.0), LeastScoreBeside(30.0) + 2.0);
}

TEST(LiveSearch, WhatStandsAndDoesNotFloatIsNoFlight) {
  EXPECT_FALSE(BeginOfFlight(300, [](double) { return Eigen::Vector3d(0.0, 0.0, kRangeM); }));
}

}  // namespace
}  // namespace unlidar
