// The linear-Gaussian model behind a trajectory: measurements and the smoothness prior as rows over
// the control points of a spline, and what follows from them in closed form.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "unlidar/trajectory.hpp"

namespace unlidar {

// Residual of control points c: sqrt_information (sum_j basis[j] c[first + j] - value_m).
struct SplineRow {
  int first = 0;
  Eigen::Vector4d basis = Eigen::Vector4d::Zero();
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Identity();
  Eigen::Vector3d value_m = Eigen::Vector3d::Zero();
};

inline Eigen::Vector3d Residual(const SplineRow& row, const std::vector<Eigen::Vector3d>& control) {
  Eigen::Vector3d position = -row.value_m;
  for (int j = 0; j < 4; ++j) {
    position += row.basis[j] * control[static_cast<std::size_t>(row.first + j)];
  }
  return row.sqrt_information * position;
}

// All scales are relative to the noise: the posterior of the noise scale k is then known in closed
// form, and only the ratio sigma_a / k is left to be searched.
struct SplineModel {
  Eigen::Vector3d origin_m = Eigen::Vector3d::Zero();
  std::vector<double> knots_s;
  std::vector<SplineRow> measurements;
  std::vector<SplineRow> smoothness;  // for sigma_a = 1 m/s^2
  std::vector<SplineRow> start;       // nearly nothing about the first position and velocity
  int num_control_points() const { return static_cast<int>(knots_s.size()) - 4; }
};

struct SplineFit {
  std::vector<Eigen::Vector3d> control_points_m;
  std::vector<double> weights;
};

SplineModel BuildSplineModel(const std::vector<Measurement>& measurements,
                             const TrajectoryConfig& config);

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
