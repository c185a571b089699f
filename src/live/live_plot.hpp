// What the stages of a stream hand on to each other: plots, and paths of them.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "scene/plots.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// A plot as a measurement of a target, before it is known how fast that moves.
struct LivePlot {
  Plot plot;
  double time_s = 0.0;  // of the middle of its frame, since the first frame began
  TimeNs stamp_ns = 0;  // of its frame
  std::optional<double>
      dwell_begin_s;  // when the dwell of its place began, as time_s, if that is known
  double log_surrounding_clutter =
      0.0;  // log_clutter of its plot, were nothing at the place itself
  Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();  // sum over its returns, about their mean
};

// A path of plots that only a flying target explains: each of another frame, in order of time.
struct Flight {
  std::vector<LivePlot> plots;
  std::vector<FrameTime> frame_times;  // (plots)
  double log_birth = 0.0;              // of its first plot, as LogBirths
  bool starts_new_target = false;      // what was before is another thing
};

}  // namespace unlidar
