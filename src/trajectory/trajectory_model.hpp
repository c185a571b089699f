// What follows from the linear-Gaussian model behind a trajectory: robust minimum, scales and
// covariances, in closed form but for the outliers and one ratio.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "trajectory/banded.hpp"
#include "trajectory/spline_model.hpp"
#include "trajectory/spline_solver.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/truncated_loss.hpp"

namespace unlidar {

struct SplineFit {
  std::vector<Eigen::Vector3d> control_points_m;
  std::vector<double> weights;
  bool is_minimum = false;  // the control points and the inverse are those of just these weights
  BandedMatrix inverse;     // of the normal equations' matrix: the covariance where the noise is 1
};

// What the steps of a fit work with, kept for the next one.
struct FitMemory {
  SplineSolver solver;  // whoever changes the model tells it the smoothness
  std::vector<double> weights;
  struct Candidate {
    double log_acceleration, log_noise, log_posterior;
  };
  std::vector<Candidate> candidates;
  std::vector<double> bests;  // (ratios) of their log posteriors
};

// (3, 3) covariance of sum_j basis[j] c[first + j], where the noise is 1.
Eigen::Matrix3d CovarianceOfSum(int first, const Eigen::Vector4d& basis,
                                const BandedMatrix& inverse);

// The loss of a measurement at these scales.
TruncatedLoss LossOf(const TrajectoryScales& scales, const TrajectoryConfig& config);

// Robust minimum at given scales by reweighted least squares. The limit of the loss starts at the
// largest residual and is halved until it is the wanted one: the worst outliers go first, before
// they can pull good measurements over the limit.
void FitRobust(const SplineModel& model, const TrajectoryScales& scales,
               const TrajectoryConfig& config, FitMemory& memory, SplineFit& fit);

// The same from a fit of nearly the same model at these scales: which measurements are outliers is
// known but for a few.
void RefitRobust(const SplineModel& model, const TrajectoryScales& scales,
                 const TrajectoryConfig& config, FitMemory& memory, SplineFit& fit);

// Moves a fit that is nearly there to the robust minimum: the loss of the residuals, not of the
// innovations. The loss is concave in s, so that the squares reweighted at a point lie above it and
// touch it there (majorisation and minimisation): no step makes it worse.
MinimumReport Descend(const SplineModel& model, const TrajectoryScales& scales,
                      const TrajectoryConfig& config, FitMemory& memory, SplineFit& fit);

// Sets weights and inverse to those of the control points, which are those of the robust minimum.
void AdoptMinimum(const SplineModel& model, const TrajectoryScales& scales,
                  const TrajectoryConfig& config, FitMemory& memory, SplineFit& fit);

// Scales by their posterior means, at the tau of the model, and the evidence for that, at given
// weights and as agile all along. The mean of sigma_a, not its mode: with a few measurements the
// mode says that nothing can ever accelerate.
struct ScaleSearch {
  TrajectoryScales scales;
  double log_evidence = 0.0;
};
ScaleSearch SearchScales(const SplineModel& model, const SplineFit& fit,
                         const TrajectoryConfig& config, FitMemory& memory);

// Posterior covariance of neighbouring control points, see Trajectory::covariances_m2.
void SetCovariances(const SplineFit& fit, const TrajectoryScales& scales,
                    std::vector<std::array<Eigen::Matrix3d, 4>>& covariances_m2);

}  // namespace unlidar
