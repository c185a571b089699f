// Inference in the linear-Gaussian model behind a trajectory: robust minimum, scales and
// covariances, in closed form except for the outliers and one ratio.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "base/maths.hpp"
#include "trajectory/banded.hpp"
#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

// Mahalanobis distance (3-D) beyond which a measurement is likelier an outlier.
constexpr double kOutlierSigmas = 4.5;

// Robust loss of a measurement, for the banded solver and for Ceres: the smooth truncated square of
// graduated non-convexity (Yang, Antonante, Tzoumas and Carlone, 2020, eq. 13 and 14 with mu = 1)
// of a squared residual s, with c^2 = squared_limit:
//   rho(s) = s                           up to c^2 / 2,
//            2 sqrt(2 c^2 s) - c^2 - s   up to 2 c^2,
//            c^2                         beyond.
// It is concave: rho'(s) is the weight of a measurement in reweighted least squares.
struct TruncatedLoss {
  double squared_limit;

  double Value(double s) const {
    if (IsInlier(s)) return s;
    if (IsOutlier(s)) return squared_limit;
    return 2.0 * std::sqrt(2.0 * squared_limit * s) - squared_limit - s;
  }

  // rho'
  double Weight(double s) const {
    if (IsInlier(s)) return 1.0;
    if (IsOutlier(s)) return 0.0;
    return std::sqrt(2.0 * squared_limit / s) - 1.0;
  }

  // rho''
  double Curvature(double s) const {
    if (IsInlier(s) || IsOutlier(s)) return 0.0;
    return -0.5 * std::sqrt(2.0 * squared_limit / s) / s;
  }

 private:
  bool IsInlier(double s) const { return s <= 0.5 * squared_limit; }
  bool IsOutlier(double s) const { return s >= 2.0 * squared_limit; }
};

struct SplineFit {
  std::vector<Eigen::Vector3d> control_points_m;
  std::vector<double> weights;
  bool is_minimum = false;  // control points and inverse belong to these weights
  BandedMatrix inverse;     // of the normal matrix: the covariance at noise 1
};

// Buffers of a fit, kept for reuse.
struct FitMemory {
  SplineSolver solver;  // SetSmoothness() is due after each change of the model
  std::vector<double> weights;
  struct Candidate {
    double log_acceleration, log_noise, log_posterior;
  };
  std::vector<Candidate> candidates;
  std::vector<double> bests;  // (ratios) best log posterior
};

// The loss of a measurement at these scales.
inline TruncatedLoss LossOf(const TrajectoryScales& scales) {
  return {Square(kOutlierSigmas) * Square(scales.noise)};
}

// Robust minimum at given scales by reweighted least squares. The limit of the loss starts at the
// largest residual and is halved down to its final value: the worst outliers are removed first,
// before they can pull good measurements beyond the limit.
void FitRobust(const SplineModel& model, const TrajectoryScales& scales, FitMemory& memory,
               SplineFit& fit);

// Same from the weights of a fit, with a limit that starts at `limit`; 0: at the largest
// innovation. From a fit of nearly the same model, most of whose outliers are known: at the last.
void Reweight(const SplineModel& model, const TrajectoryScales& scales, double limit,
              FitMemory& memory, SplineFit& fit);

// Moves a nearly converged fit to the robust minimum, with the loss of the residuals, not of the
// innovations. The loss is concave in s, so that the squares reweighted at a point majorise it
// there (majorisation-minimisation): no step increases it.
MinimumReport Descend(const SplineModel& model, const TrajectoryScales& scales, FitMemory& memory,
                      SplineFit& fit);

// Sets weights and inverse to those of the control points, which must be at the robust minimum.
void AdoptMinimum(const SplineModel& model, const TrajectoryScales& scales, FitMemory& memory,
                  SplineFit& fit);

// Moves control points to the minimum (method.md (15)) of
//   1/2 (sum rho(|r_i|^2) + k^2 / sigma_a^2 sum |r_j|^2 + sum |r_l|^2)
// over the residuals of the measurements i, the smoothness j and the start l of a model, the same
// minimum as Descend(), with Ceres' trust region: for the trajectories of recordings. Runs on one
// thread, so that results are reproducible bit by bit. Throws std::bad_alloc.
MinimumReport MinimiseByCeres(const SplineModel& model, const TrajectoryScales& scales,
                              const TruncatedLoss& loss, int max_iterations,
                              std::vector<Eigen::Vector3d>& control_points_m);

// Posterior means of the scales at the tau of the model, and the evidence for that tau, at given
// weights and constant agility. The mean of sigma_a, because with few measurements its mode is near
// zero.
struct ScaleSearch {
  TrajectoryScales scales;
  double log_evidence = 0.0;
};
ScaleSearch SearchScales(const SplineModel& model, const SplineFit& fit,
                         const TrajectoryConfig& config, FitMemory& memory);

}  // namespace unlidar
