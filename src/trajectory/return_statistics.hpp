// Statistics of the returns of a target: return rate and extent.
#pragma once

#include "base/recording.hpp"
#include "trajectory/target.hpp"

namespace unlidar {

// Informative only, not used for the kind: drones and birds of one size reflect alike.
struct ReturnStatistics {
  double echo_m2_per_s = 0.0;  // return rate: returns per second times range^2
  double extent_m = 0.0;       // RMS distance of the returns from the trajectory, across the ray
};

// The target must have a trajectory.
ReturnStatistics DescribeReturns(const Recording& recording, const Target& target);

}  // namespace unlidar
