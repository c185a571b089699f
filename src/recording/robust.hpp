// method: robust - targets by likelihood ratio against the clutter of their places.
//
// 1. Background: which places were occupied at other times (structure), and how often.
// 2. Plots: clusters per frame of returns that are not structure, or that are unsupported, with the
//    clutter intensity of their place.
// 3. Paths: sequences of plots that a flying target explains far better than clutter.
// 4. Collection: all returns along a path, their mean per frame, and the trajectory through these.
//
// Positions are in the common frame, z up. Sensors close together form a station; 1 and 2 are done
// per station, about its viewpoint; paths use the plots of all stations.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/rejection.hpp"
#include "tracking/tracker.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Counts and thresholds of a search, for the summary.
struct RobustCounts {
  std::size_t unexplained_returns = 0;
  std::size_t body_returns = 0;
  std::size_t plots = 0;
  std::size_t paths = 0;
  double score_threshold = 0.0;  // that a path must reach
  double false_alarms = 0.0;     // expected tracks of clutter, upper bound
};

struct RobustResult {
  std::vector<Target> targets;  // by falling score
  RobustCounts counts;
};

// Measurements and decisions of a search, for --trace.
struct SearchTrace {
  const std::vector<Plot>& plots;            // in order of time
  const std::vector<char>& are_bodies;       // (returns)
  const std::vector<Path>& paths;            // by falling score
  const std::vector<PathVerdict>& verdicts;  // (paths) without their scores
  double score_threshold;
};

// Called at the end of a search; recording and trace are valid during the call only.
using TraceSink = std::function<void(const Recording& recording, const SearchTrace& trace)>;

// `trace`, if set, receives the measured quantities and the reasons for rejected paths.
RobustResult FindTargetsRobust(const Recording& recording, const RobustConfig& config,
                               const TrajectoryConfig& trajectory_config,
                               const TraceSink& trace = nullptr);

// Appends the next frames of a recording, those stamped before `until_ns`, which ascends from call
// to call, and sets the sensors. Returns the stamp of the following frame; the largest TimeNs if
// there is none.
using FrameFeed = std::function<TimeNs(TimeNs until_ns, Recording* recording)>;

// FindTargetsRobust() for a recording of any length, in the memory of one window: association with
// hindsight needs the whole of what it looks at. Windows have equal lengths, at most
// robust.window_s; a longer recording has several, each of them searched with
// robust.window_margin_s on both sides. Two targets of neighbouring windows are merged if they
// share most of their returns near the border, where the one hands over to the other. `recording`,
// initially empty, receives the sensors, all frames, and the returns of the targets, whose indices
// refer to it. `trace`, if set, receives each window with its margins: frames near a border are in
// two.
//
// The counts are sums over the windows, margins included, and the largest threshold.
RobustResult FindTargetsInWindows(const FrameFeed& feed, TimeNs first_stamp_ns,
                                  TimeNs last_stamp_ns, const RobustConfig& config,
                                  const TrajectoryConfig& trajectory_config, const TraceSink& trace,
                                  Recording* recording);

}  // namespace unlidar
