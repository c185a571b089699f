// What the returns of a target look like: how strong its echo is, how far they spread.
#pragma once

#include "base/recording.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

// What its returns say of a target. Neither is weighed: drones and birds of one size reflect alike.
struct ReturnStatistics {
  double echo_m2_per_s = 0.0;  // returns per second times range^2
  double extent_m = 0.0;       // RMS distance of the returns from the trajectory, across the ray
};

// Of a target with at least one measurement, and its trajectory.
ReturnStatistics DescribeReturns(const Recording& recording, const Target& target,
                                 const Trajectory& trajectory);

}  // namespace unlidar
