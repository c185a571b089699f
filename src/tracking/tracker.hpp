// The path of plots that a flying target explains best: a search over all times at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/plots.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// When and from where each sensor watches the air.
struct ScanSchedule {
  struct Sensor {
    double frame_s = 0.1;                                   // how long a frame lasts
    std::vector<TimeNs> frame_times_ns;                     // middles of its frames, ascending
    Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();  // of its station
  };
  std::vector<Sensor> sensors;

  std::uint32_t FramesBefore(std::uint32_t sensor, TimeNs time_ns) const;
};

ScanSchedule ScanScheduleOf(const Recording& recording);

struct Path {
  std::vector<std::uint32_t> plots;  // ascending
  // Log likelihood ratio against clutter, relative to that of an even choice of the first plot.
  double score = 0.0;
};

// How much was looked at besides the searches of everything.
struct Effort {
  std::size_t pairs_compared = 0;  // of paths
  std::size_t plots_searched_again = 0;
};

// Paths by falling score through plots that come frame by frame in order of time. Each has at most
// one plot of a frame. They are found by dynamic programming over frames, where every plot keeps
// the best few ways to reach it, each with its Kalman state (Singer's model); then the next in what
// is left. As this takes the best first, pairs of paths then exchange tails, or join, as long as
// the sum of their scores grows: crossing targets find their own continuation.
// `effort`, if there is one, is told what that took.
std::vector<Path> FindPaths(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                            const TrackerConfig& config, Effort* effort = nullptr);

}  // namespace unlidar
