// Robust minimum of a fit by Ceres, used for the trajectories of recordings.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/truncated_loss.hpp"

namespace unlidar {

// Moves control points to the minimum (method.md (15)) of
//   1/2 (sum rho(|r_i|^2) + k^2 / sigma_a^2 sum |r_j|^2 + sum |r_l|^2)
// over the residuals of the measurements i, the smoothness j and the start l of a model, the same
// minimum as Descend(), with Ceres' trust region. Runs on one thread, so that results are
// reproducible bit by bit. Throws std::bad_alloc.
MinimumReport MinimiseByCeres(const SplineModel& model, const TrajectoryScales& scales,
                              const TruncatedLoss& loss, int max_iterations,
                              std::vector<Eigen::Vector3d>& control_points_m);

}  // namespace unlidar
