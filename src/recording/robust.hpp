// method: robust - targets from a likelihood ratio against the clutter of their place.
//
// 1. Background: which places were occupied at other times (structure), and how often.
// 2. Plots: what structure does not explain, or what floats in the air, per frame, with the clutter
//    rate at its place.
// 3. Paths: the sequences of plots that a flying target explains far better than clutter.
// 4. Collection: all returns along a path, and their mean per frame.
//
// Positions are in the common frame, z up. Sensors that stand together are a station; 1 and 2 are
// those of each station by itself, about its viewpoint, and paths lead through the plots of all.
#pragma once

#include <cstddef>
#include <vector>

#include "base/recording.hpp"
#include "collection/collect.hpp"
#include "recording/trace.hpp"
#include "scene/background.hpp"
#include "scene/ground.hpp"
#include "scene/plots.hpp"
#include "scene/support.hpp"
#include "tracking/tracker.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// What was found on the way, for the summary.
struct RobustCounts {
  std::size_t unexplained_returns = 0;
  std::size_t body_returns = 0;
  std::size_t plots = 0;
  std::size_t paths = 0;
  double score_threshold = 0.0;  // that a path must reach
  double null_score = 0.0;       // that the clutter reaches with its frames in random order
  double false_alarms = 0.0;     // tracks of clutter that are to be expected, at most
};

struct RobustResult {
  std::vector<Target> targets;  // by falling score
  RobustCounts counts;
};

// `trace`, if there is one, is told what was measured and why paths were refused.
RobustResult FindTargetsRobust(const Recording& recording, const RobustConfig& config,
                               const TrajectoryConfig& trajectory_config,
                               const TraceSink& trace = nullptr);

}  // namespace unlidar
