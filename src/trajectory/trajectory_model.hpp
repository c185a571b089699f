// What follows from the linear-Gaussian model behind a trajectory: robust minimum, scales and
// covariances, in closed form but for the outliers and one ratio.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

struct SplineFit {
  std::vector<Eigen::Vector3d> control_points_m;
  std::vector<double> weights;
};

// The smooth truncated square of graduated non-convexity (Yang, Antonante, Tzoumas and Carlone,
// 2020, eq. 13 and 14 with mu = 1): s up to c^2 / 2, constant from 2 c^2. Weight is its derivative.
double TruncatedLoss(double s, double squared_limit);
double TruncatedWeight(double s, double squared_limit);

// Robust minimum at given scales by reweighted least squares. The limit of the loss starts at the
// largest residual and is halved until it is the wanted one: the worst outliers go first, before
// they can pull good measurements over the limit.
SplineFit FitRobust(const SplineModel& model, const TrajectoryScales& scales,
                    const TrajectoryConfig& config);

// Scales by their posterior means and the evidence for them, at given weights. The mean of sigma_a,
// not its mode: with a few measurements the mode says that nothing can ever accelerate.
struct ScaleSearch {
  TrajectoryScales scales;
  double log_evidence = 0.0;
};
ScaleSearch SearchScales(const SplineModel& model, const SplineFit& fit,
                         const TrajectoryConfig& config);

// Posterior covariance of neighbouring control points, see Trajectory::covariances_m2.
std::vector<std::array<Eigen::Matrix3d, 4>> ControlPointCovariances(
    const SplineModel& model, const std::vector<double>& weights, const TrajectoryScales& scales);

}  // namespace unlidar
