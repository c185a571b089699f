// Dwells of a target: before and after its flight, and at a place on its way.
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

// Adds to a path the plots of a dwell that ends where and when the path begins (a drone that hovers
// over its pad before it climbs), and of one that begins where and when it ends. Plots are in order
// of time; frame, sensor, times, position and returns are used and set. Returns so near the ground
// are no evidence by themselves; where there are none while the target is elsewhere, they are the
// target's. `taken` (N): returns assigned to others.
void AddDwells(const Recording& recording, const std::vector<char>& taken, std::vector<Plot>* path);

// Returns the interval about `time_ns` in which the target is within `reach_m` of a place, extended
// to either side in steps of 250 ms; the last step may pass the end of the trajectory.
//
// A spline lies in the convex hull of its control points, so long dwells are found by these instead
// of sampling.
std::pair<TimeNs, TimeNs> DwellAround(const Trajectory& trajectory, TimeNs time_ns,
                                      const Eigen::Vector3d& place_m, double reach_m);

}  // namespace unlidar
