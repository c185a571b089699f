// Plots with known truth: flights and clutter.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "tests/synthetic_recording.hpp"
#include "tracking/tracker.hpp"

namespace unlidar::testing {

using Flight = std::function<Eigen::Vector3d(double time_s)>;

inline Plot MakePlot(TimeNs time_ns, const Eigen::Vector3d& position_m, double log_clutter,
                     std::size_t num_returns = 1) {
  Plot plot;
  plot.time_ns = time_ns;
  plot.frame_time_ns = time_ns;
  plot.streak_s = kPeriodS;
  plot.position_m = plot.ray_m = position_m;
  plot.variance_m2 = 0.02 + 0.01 / static_cast<double>(num_returns);
  plot.log_clutter = log_clutter;
  plot.frame = static_cast<std::uint32_t>((time_ns - kBeginNs) / kPeriodNs);
  plot.num_returns = static_cast<std::uint32_t>(num_returns);
  return plot;
}

// Of sensors that watch without a pause from the first plot to the last, all at the same times.
inline ScanSchedule WatchOver(const std::vector<Plot>& plots, int num_sensors = 1) {
  ScanSchedule::Sensor sensor{kPeriodS, {}};
  if (!plots.empty()) {
    for (TimeNs time_ns = plots.front().frame_time_ns; time_ns <= plots.back().frame_time_ns;
         time_ns += kPeriodNs) {
      sensor.frame_times_ns.push_back(time_ns);
    }
  }
  return {std::vector<ScanSchedule::Sensor>(static_cast<std::size_t>(num_sensors), sensor)};
}

// Each plot is that of any of the sensors.
inline void MixSensors(int num_sensors, Random* random, std::vector<Plot>* plots) {
  for (Plot& plot : *plots) plot.sensor = random->Index(static_cast<std::size_t>(num_sensors));
}

inline void SortByTime(std::vector<Plot>* plots) {
  std::stable_sort(plots->begin(), plots->end(),
                   [](const Plot& a, const Plot& b) { return a.frame_time_ns < b.frame_time_ns; });
}

inline std::vector<Plot> Members(const std::vector<Plot>& plots,
                                 const std::vector<std::uint32_t>& path) {
  std::vector<Plot> members;
  for (const std::uint32_t i : path) members.push_back(plots[i]);
  return members;
}

inline constexpr double kScoreTolerance = 1e-3;

// A target that is seen in a share of the frames.
inline void AddFlight(const Flight& at, int num_frames, double share, double log_clutter,
                      Random* random, std::vector<Plot>* plots) {
  for (int i = 0; i < num_frames; ++i) {
    if (random->Uniform(0.0, 1.0) > share) continue;
    plots->push_back(MakePlot(kBeginNs + i * kPeriodNs,
                              at(i * kPeriodS) + random->NormalVector(0.15), log_clutter, 3));
  }
}

inline void AddClutter(double per_frame, int num_frames, const Eigen::Vector3d& low_m,
                       const Eigen::Vector3d& high_m, Random* random, std::vector<Plot>* plots) {
  const double log_clutter = std::log(per_frame / (high_m - low_m).prod());
  for (int i = 0; i < num_frames; ++i) {
    const int count = random->Poisson(per_frame);
    for (int k = 0; k < count; ++k) {
      plots->push_back(
          MakePlot(kBeginNs + i * kPeriodNs, random->InBox(low_m, high_m), log_clutter));
    }
  }
}

// A plot of one of three sensors, with or without times of its points.
inline Plot RandomPlot(TimeNs time_ns, const Eigen::Vector3d& position_m, Random* random) {
  Plot plot = MakePlot(time_ns, position_m, random->Uniform(-10.0, 0.0), 1 + random->Index(20));
  plot.variance_m2 = random->Uniform(0.005, 0.2);
  plot.sensor = random->Index(3);
  if (random->Index(2) == 0) {
    plot.time_ns += static_cast<TimeNs>(random->Index(100'000'000)) - kPeriodNs / 2;
    plot.streak_s = 0.0;
  }
  return plot;
}

}  // namespace unlidar::testing
