// Time intervals in which a target stays near a place.
#pragma once

#include <Eigen/Core>
#include <utility>

#include "trajectory/trajectory.hpp"

namespace unlidar {

// Returns the interval about `time_ns` in which the target is within `reach_m` of a place, extended
// to either side in steps of 250 ms; the last step may pass the end of the trajectory.
//
// A spline lies in the convex hull of its control points, so long dwells are found by these instead
// of sampling.
std::pair<TimeNs, TimeNs> DwellAround(const Trajectory& trajectory, TimeNs time_ns,
                                      const Eigen::Vector3d& place_m, double reach_m);

}  // namespace unlidar
