// Data passed between the stages of a stream: plots and flights.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include "base/block_queue.hpp"
#include "base/maths.hpp"
#include "collection/facing_side.hpp"
#include "scene/plots.hpp"
#include "tracking/rejection.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// A plot as a measurement of a target, before the velocity of the target is known.
struct LivePlot {
  Plot plot;
  double time_s = 0.0;  // middle of its frame, since the start of the first frame
  TimeNs stamp_ns = 0;  // of its frame
  // Start of the dwell of its place, same origin as time_s; not a number if it is not known.
  double dwell_begin_s = std::numeric_limits<double>::quiet_NaN();
  // log_clutter from the neighbourhood alone, without spot and place.
  double log_surrounding_clutter = 0.0;
  std::uint32_t bin = 0;  // time bin of its frame
  // Sums over its returns: of the squares of their offsets from their mean, of the products of
  // these and the offsets of their times, and of the squares of the latter.
  SymmetricMatrix scatter_m2;
  Eigen::Vector3f time_covariance_ms = Eigen::Vector3f::Zero();
  float time_scatter_s2 = 0.0F;
  FacingSums facing_sums;

  // Sum of the squares of the offsets of its returns from a target that moves, about their mean.
  Eigen::Matrix3d ScatterM2(const Eigen::Vector3d& velocity_mps) const {
    const Eigen::Matrix3d moved_m2 = (time_covariance_ms.cast<double>() -
                                      0.5 * static_cast<double>(time_scatter_s2) * velocity_mps) *
                                     velocity_mps.transpose();
    return scatter_m2.Full() - moved_m2 - moved_m2.transpose();
  }
};

// Plots of the last frames, in order of time.
using RecentPlots = BlockQueue<LivePlot>;

// True if at least half of the plots of a path float.
inline bool Floats(const std::vector<LivePlot>& path) {
  const auto num_floating = std::count_if(
      path.begin(), path.end(), [](const LivePlot& seen) { return seen.plot.is_floating; });
  return 2 * static_cast<std::size_t>(num_floating) >= path.size();
}

// A path that is attributed to a flying target: plots of different frames, in order of time.
struct Flight {
  std::vector<LivePlot> plots;
  std::vector<FrameTime> frame_times;  // (plots)
  double log_birth = 0.0;              // of the first plot, same as LogBirths
};

// Leading plots of a path that a rule cuts off: they belong to no flight.
struct PathCut {
  Rejection rule = Rejection::kNone;
  std::size_t num_plots = 0;
};

// Known targets in the frame at hand.
struct KnownTargets {
  Eigen::AlignedBox3d box_m;  // around them and all places at which one may be; empty: none
  // True if a target is at a place within the box and was there at `dwell_begin_s`.
  std::function<bool(const Eigen::Vector3d& place_m, double dwell_begin_s)> are_at;
};

}  // namespace unlidar
