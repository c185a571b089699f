// Going back for the rest: all returns of a target, once it is known where it flew.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "robust/plots/plots.hpp"
#include "robust/scene/background.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

struct CollectConfig {
  int rounds = 3;                // of fit and collection
  double body_sigma_m = 0.15;    // spread of the returns over the body, per axis
  double centre_sigma_m = 0.04;  // of the mean of a frame's returns: which parts are hit
  // The centre of a body lies behind the mean of its returns by this share of their spread: 1.33
  // for a ball, less for a flat thing with gaps; 0 leaves the mean. How well that is known.
  double facing_side = 0.4;
  double facing_side_sigma = 0.3;
  double beam_sigma_rad = 0.002;  // growth of the spread with range
  // By so much a return must be likelier the target's than its place's: the target may be hidden.
  double min_return_log = 2.0;
  double gate = 4.0;                // standard deviations in which a return may lie
  double max_search_sigma_m = 1.0;  // where the trajectory is less sure, nothing is collected
  double max_extension_s = 2.0;     // beyond the ends, per round
  RangeRadius presence{1.5, 0.03};  // the target's stay at a place says nothing of its clutter
  // How far two sensors disagree, prior standard deviations: in place and clock.
  double sensor_bias_m = 0.2;
  double sensor_delay_s = 0.05;
  double sensor_overlap_s = 0.3;  // longest pause of the main one across which they are compared
};

// The target of a path: its returns, and per frame their mean. `excluded` returns (N) are left
// alone. Empty measurements where nothing fits.
Target CollectTarget(const Recording& recording, const Background& background,
                     const std::vector<Plot>& path, const std::vector<char>& excluded,
                     const CollectConfig& config, const TrajectoryConfig& trajectory_config);

}  // namespace unlidar
