#include "trajectory/trajectory_model.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>

#include "base/square.hpp"
#include "trajectory/banded.hpp"

namespace unlidar {
namespace {

constexpr double kScaleStep = 0.35;  // of the grids of log scales

std::size_t Index(int i) { return static_cast<std::size_t>(i); }

// Normal equations of weighted rows, linearised at the control points: A and -A'r.
struct NormalEquations {
  BandedMatrix matrix;
  Eigen::VectorXd descent;
};

NormalEquations ZeroNormalEquations(int num_control_points) {
  return {ZeroBandedMatrix(3 * num_control_points), Eigen::VectorXd::Zero(3 * num_control_points)};
}

void AddRow(const SplineRow& row, double weight, const std::vector<Eigen::Vector3d>& control,
            NormalEquations& equations) {
  const Eigen::Matrix3d information =
      weight * row.sqrt_information.transpose() * row.sqrt_information;
  const Eigen::Vector3d force = -weight * row.sqrt_information.transpose() * Residual(row, control);
  for (int a = 0; a < 4; ++a) {
    equations.descent.segment<3>(3 * (row.first + a)) += row.basis[a] * force;
    for (int c = 0; c < 3; ++c) {
      auto& column = equations.matrix[Index(3 * (row.first + a) + c)];
      for (int r = c; r < 3; ++r) {
        column[r - c] += row.basis[a] * row.basis[a] * information(r, c);
      }
      for (int b = a + 1; b < 4; ++b) {
        for (int r = 0; r < 3; ++r) {
          column[3 * (b - a) + r - c] += row.basis[a] * row.basis[b] * information(r, c);
        }
      }
    }
  }
}

NormalEquations MeasurementEquations(const SplineModel& model, const std::vector<double>& weights,
                                     const std::vector<Eigen::Vector3d>& control) {
  auto equations = ZeroNormalEquations(model.num_control_points());
  for (std::size_t i = 0; i < model.measurements.size(); ++i) {
    if (weights[i] > 0.0) AddRow(model.measurements[i], weights[i], control, equations);
  }
  for (const auto& row : model.start) AddRow(row, 1.0, control, equations);
  return equations;
}

NormalEquations SmoothnessEquations(const SplineModel& model,
                                    const std::vector<Eigen::Vector3d>& control) {
  auto equations = ZeroNormalEquations(model.num_control_points());
  for (const auto& row : model.smoothness) AddRow(row, 1.0, control, equations);
  return equations;
}

// Factor of the sum for one ratio sigma_a / k. Where few measurements and a stiff model leave no
// digits for what is nearly unknown, a ridge of relative size 1e-12 or more makes it a little
// known.
BandedMatrix FactoriseSum(const BandedMatrix& data, const BandedMatrix& smoothness, double weight) {
  for (double ridge = 0.0; ridge < 1e-5; ridge = std::max(1e-12, 100.0 * ridge)) {
    BandedMatrix factor = data;
    for (std::size_t j = 0; j < factor.size(); ++j) {
      factor[j] += weight * smoothness[j];
      factor[j][0] *= 1.0 + ridge;
    }
    if (FactoriseBanded(factor)) return factor;
  }
  throw std::invalid_argument("trajectory: measurements too extreme for double precision");
}

// Moves the control points to the minimum for one ratio sigma_a / k and returns the factor of A.
BandedMatrix Minimise(const NormalEquations& data, const NormalEquations& smoothness, double ratio,
                      std::vector<Eigen::Vector3d>& control) {
  const double weight = 1.0 / (ratio * ratio);
  BandedMatrix factor = FactoriseSum(data.matrix, smoothness.matrix, weight);
  Eigen::VectorXd step = data.descent + weight * smoothness.descent;
  SolveBanded(factor, step);
  for (std::size_t i = 0; i < control.size(); ++i) {
    control[i] += step.segment<3>(static_cast<Eigen::Index>(3 * i));
  }
  return factor;
}

// Block of the inverse that belongs to the control points i and i + d.
Eigen::Matrix3d InverseBlock(const BandedMatrix& inverse, int i, int d) {
  Eigen::Matrix3d block;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      const int low = std::min(3 * i + r, 3 * (i + d) + c);
      const int high = std::max(3 * i + r, 3 * (i + d) + c);
      block(r, c) = inverse[Index(low)][high - low];
    }
  }
  return block;
}

// Squared Mahalanobis distance of a measurement from what all others predict. With V = the
// posterior covariance in units of the measurement's own, w its weight in it and r its residual:
// innovation (I - w V)^-1 r of covariance I + (I - w V)^-1 V.
double SquaredInnovation(const SplineRow& row, double weight, const BandedMatrix& inverse,
                         const std::vector<Eigen::Vector3d>& control) {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (int a = 0; a < 4; ++a) {
    for (int b = a; b < 4; ++b) {
      const Eigen::Matrix3d block = InverseBlock(inverse, row.first + a, b - a);
      covariance +=
          (a == b ? 0.5 : 1.0) * row.basis[a] * row.basis[b] * (block + block.transpose());
    }
  }
  const Eigen::Matrix3d v = row.sqrt_information * covariance * row.sqrt_information.transpose();
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  const Eigen::Vector3d r = Residual(row, control);
  // (I - w V)^-T (I + (I - w V)^-1 V)^-1 (I - w V)^-1 = (I - w V)^-1 (I + (1 - w) V)^-1
  // A measurement that the fit rests on alone (w V = I but for rounding) cannot be tested.
  const Eigen::Matrix3d left = (1.0 + 1e-6) * identity - weight * v;
  const Eigen::Matrix3d right = identity + (1.0 - weight) * v;
  return r.dot((left * right).ldlt().solve(r));
}

double Ratio(const TrajectoryScales& scales) { return scales.acceleration_mps2 / scales.noise; }

double SquaredOutlierDistance(const TrajectoryConfig& config) {
  return config.outlier_distance * config.outlier_distance;
}

double LargestDifference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

}  // namespace

double TruncatedLoss(double s, double squared_limit) {
  if (s <= 0.5 * squared_limit) return s;
  if (s >= 2.0 * squared_limit) return squared_limit;
  return 2.0 * std::sqrt(2.0 * s * squared_limit) - squared_limit - s;
}

double TruncatedWeight(double s, double squared_limit) {
  if (s <= 0.5 * squared_limit) return 1.0;
  if (s >= 2.0 * squared_limit) return 0.0;
  return std::sqrt(2.0 * squared_limit / s) - 1.0;
}

SplineFit FitRobust(const SplineModel& model, const TrajectoryScales& scales,
                    const TrajectoryConfig& config) {
  constexpr int kMaxFinalIterations = 15;
  constexpr double kWeightTolerance = 1e-4;
  SplineFit fit;
  fit.control_points_m.assign(Index(model.num_control_points()), Eigen::Vector3d::Zero());
  fit.weights.assign(model.measurements.size(), 1.0);
  const NormalEquations smoothness = SmoothnessEquations(model, fit.control_points_m);
  const double final_limit = SquaredOutlierDistance(config) * Square(scales.noise);
  double limit = 0.0;
  for (int left = kMaxFinalIterations; left > 0;) {
    // The smoothness rows have no value: their descent is that of the origin, kept at zero.
    std::fill(fit.control_points_m.begin(), fit.control_points_m.end(), Eigen::Vector3d::Zero());
    const auto inverse =
        InvertWithinBand(Minimise(MeasurementEquations(model, fit.weights, fit.control_points_m),
                                  smoothness, Ratio(scales), fit.control_points_m));
    std::vector<double> s;
    for (std::size_t i = 0; i < model.measurements.size(); ++i) {
      s.push_back(
          SquaredInnovation(model.measurements[i], fit.weights[i], inverse, fit.control_points_m));
    }
    limit = limit == 0.0 ? *std::max_element(s.begin(), s.end()) : 0.25 * limit;
    if (limit <= final_limit) {
      limit = final_limit;
      --left;
    }
    for (double& value : s) value = TruncatedWeight(value, limit);
    const double change = LargestDifference(s, fit.weights);
    // Scales so wrong that no measurement fits: what was believed last is all there is.
    if (*std::max_element(s.begin(), s.end()) == 0.0) break;
    fit.weights = s;
    if (limit == final_limit && change < kWeightTolerance) break;
  }
  return fit;
}

ScaleSearch SearchScales(const SplineModel& model, const SplineFit& fit,
                         const TrajectoryConfig& config) {
  const double limit = SquaredOutlierDistance(config);
  const NormalEquations data = MeasurementEquations(model, fit.weights, fit.control_points_m);
  const NormalEquations smoothness = SmoothnessEquations(model, fit.control_points_m);
  double used = 0.0;
  double outlier_cost = 0.0;  // makes the reweighted squares an upper bound of the loss
  for (const double weight : fit.weights) {
    used += weight;
    outlier_cost += limit * (1.0 - weight) / (1.0 + weight);
  }
  // Six numbers, first position and velocity, are nearly free. The acceleration has one per knot
  // between intervals.
  const double freedom = std::max(0.0, 3.0 * used - 6.0);
  const double smooth_rank = 3.0 * (model.num_control_points() - 2);

  struct Candidate {
    double log_acceleration, log_noise, log_posterior;
  };
  std::vector<Candidate> candidates;
  const double log_min_k = std::log(config.min_noise_scale);
  const double log_max_k = std::log(config.max_noise_scale);
  const double log_min_a = std::log(config.min_acceleration_mps2);
  const double log_max_a = std::log(config.max_acceleration_mps2);
  const double begin = log_min_a - log_max_k;
  const double end = log_max_a - log_min_k;
  const int num_ratios = 1 + static_cast<int>(std::ceil((end - begin) / kScaleStep));
  const int num_noises = 1 + static_cast<int>(std::ceil((log_max_k - log_min_k) / 0.1));
  for (int i = 0; i < num_ratios; ++i) {
    const double log_ratio = begin + (end - begin) * i / (num_ratios - 1);
    auto control = fit.control_points_m;
    const auto factor = Minimise(data, smoothness, std::exp(log_ratio), control);
    double misfit = 0.0;
    for (const auto& row : model.start) misfit += Residual(row, control).squaredNorm();
    for (std::size_t m = 0; m < model.measurements.size(); ++m) {
      misfit += fit.weights[m] * Residual(model.measurements[m], control).squaredNorm();
    }
    double roughness = 0.0;
    for (const auto& row : model.smoothness) roughness += Residual(row, control).squaredNorm();
    misfit += roughness * std::exp(-2.0 * log_ratio);
    const double volume = 0.5 * LogDeterminantBanded(factor) + smooth_rank * log_ratio;
    for (int k = 0; k < num_noises; ++k) {
      const double log_k = log_min_k + (log_max_k - log_min_k) * k / (num_noises - 1);
      const double log_a = log_ratio + log_k;
      if (log_a < log_min_a - 1e-9 || log_a > log_max_a + 1e-9) continue;
      const double prior = -0.5 * Square(log_k / config.noise_scale_spread) -
                           0.5 * Square((log_a - std::log(config.typical_acceleration_mps2)) /
                                        config.acceleration_spread);
      candidates.push_back({log_a, log_k,
                            -freedom * log_k - 0.5 * misfit * std::exp(-2.0 * log_k) - volume -
                                0.5 * outlier_cost + prior});
    }
  }
  double best = candidates.front().log_posterior;
  for (const auto& c : candidates) best = std::max(best, c.log_posterior);
  double sum = 0.0;
  double acceleration = 0.0;
  double log_noise = 0.0;
  for (const auto& c : candidates) {
    const double share = std::exp(c.log_posterior - best);
    sum += share;
    acceleration += share * std::exp(c.log_acceleration);
    log_noise += share * c.log_noise;
  }
  return {{acceleration / sum, std::exp(log_noise / sum)}, best + std::log(sum)};
}

std::vector<std::array<Eigen::Matrix3d, 4>> ControlPointCovariances(
    const SplineModel& model, const std::vector<double>& weights, const TrajectoryScales& scales) {
  std::vector<Eigen::Vector3d> control(Index(model.num_control_points()), Eigen::Vector3d::Zero());
  const auto factor = Minimise(MeasurementEquations(model, weights, control),
                               SmoothnessEquations(model, control), Ratio(scales), control);
  const auto inverse = InvertWithinBand(factor);
  std::vector<std::array<Eigen::Matrix3d, 4>> covariances(control.size());
  for (int i = 0; i < model.num_control_points(); ++i) {
    for (int d = 0; d < 4; ++d) {
      covariances[Index(i)][Index(d)] = Square(scales.noise) * InverseBlock(inverse, i, d);
    }
  }
  return covariances;
}

}  // namespace unlidar
