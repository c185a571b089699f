// The robust minimum of a fit by Ceres: of the trajectory that is written of a recording.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/truncated_loss.hpp"

namespace unlidar {

// Moves control points downhill to the minimum of
//   1/2 (sum rho(|r_i|^2) + k^2 / sigma_a^2 sum |r_j|^2 + sum |r_l|^2)
// over the residuals of the measurements i, the smoothness j and the start l of a model: where
// Descend() goes, by Ceres' trust region. On one thread, so that the same start gives the same
// bits. Throws std::bad_alloc.
MinimumReport MinimiseByCeres(const SplineModel& model, const TrajectoryScales& scales,
                              const TruncatedLoss& loss, int max_iterations,
                              std::vector<Eigen::Vector3d>& control_points_m);

}  // namespace unlidar
