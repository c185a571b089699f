#include "trajectory/trajectory_model.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

namespace unlidar {
namespace {

// Limits of sigma_a, from drifting to thrown objects, and the spreads (standard deviation of the
// logarithm) of the priors of sigma_a, of tau about its typical value, and of the noise scale:
// factors of 4.5, 2.7 and 1.6.
constexpr double kMinAccelerationMps2 = 0.05;
constexpr double kMaxAccelerationMps2 = 30.0;
constexpr double kAccelerationSpread = 1.5;
constexpr double kAccelerationTimeSpread = 1.0;
constexpr double kNoiseScaleSpread = 0.5;
// Limits of the noise scale, the ratio of true noise to that stated by the covariances.
constexpr double kMinNoiseScale = 0.5;
constexpr double kMaxNoiseScale = 3.0;
constexpr double kScaleStep = 0.35;  // of the grids of log scales

// Squared Mahalanobis distance of a measurement from the prediction of all others. With V = the
// posterior covariance in units of the measurement's own, w its weight in it and r its residual:
// innovation (I - w V)^-1 r of covariance I + (I - w V)^-1 V.
double SquaredInnovation(const SplineRow& row, double weight, const BandedMatrix& inverse,
                         const std::vector<Eigen::Vector3d>& control) {
  const Eigen::Matrix3d covariance = CovarianceOfSum(row.first, row.basis, inverse);
  const Eigen::Matrix3d v = row.sqrt_information * covariance * row.sqrt_information.transpose();
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  const Eigen::Vector3d r = Residual(row, control);
  // (I - w V)^-T (I + (I - w V)^-1 V)^-1 (I - w V)^-1 = (I - w V)^-1 (I + (1 - w) V)^-1
  // A measurement that alone determines the fit (w V = I up to rounding) cannot be tested.
  const Eigen::Matrix3d left = (1.0 + 1e-6) * identity - weight * v;
  const Eigen::Matrix3d right = identity + (1.0 - weight) * v;
  return r.dot((left * right).ldlt().solve(r));
}

double Ratio(const TrajectoryScales& scales) { return scales.acceleration_mps2 / scales.noise; }

// Sets the weights to those of the residuals at the control points. Returns true if any changes.
bool SetWeights(const SplineModel& model, const TruncatedLoss& loss, SplineFit& fit) {
  bool has_changed = false;
  for (std::size_t i = 0; i < fit.weights.size(); ++i) {
    const double s = Residual(model.measurements[i], fit.control_points_m).squaredNorm();
    const double weight = loss.Weight(s);
    has_changed = has_changed || weight != fit.weights[i];
    fit.weights[i] = weight;
  }
  return has_changed;
}

}  // namespace

void Reweight(const SplineModel& model, const TrajectoryScales& scales, double limit,
              FitMemory& memory, SplineFit& fit) {
  constexpr int kMaxFinalIterations = 15;
  constexpr double kWeightTolerance = 1e-2;
  const double final_limit = LossOf(scales).squared_limit;
  for (int left = kMaxFinalIterations; left > 0;) {
    memory.solver.SetMeasurements(model, fit.weights);
    fit.control_points_m = memory.solver.Minimise(Ratio(scales));
    memory.solver.Invert(fit.inverse);
    fit.is_minimum = true;
    std::vector<double>& s = memory.weights;
    s.clear();
    for (std::size_t i = 0; i < model.measurements.size(); ++i) {
      s.push_back(SquaredInnovation(model.measurements[i], fit.weights[i], fit.inverse,
                                    fit.control_points_m));
    }
    limit = limit == 0.0 ? *std::max_element(s.begin(), s.end()) : 0.25 * limit;
    if (limit <= final_limit) {
      limit = final_limit;
      --left;
    }
    double change = 0.0;
    for (std::size_t i = 0; i < s.size(); ++i) {
      s[i] = TruncatedLoss{limit}.Weight(s[i]);
      change = std::max(change, std::abs(s[i] - fit.weights[i]));
    }
    // The scales are so wrong that no measurement fits: keep the last weights.
    if (*std::max_element(s.begin(), s.end()) == 0.0) break;
    std::swap(fit.weights, s);
    fit.is_minimum = change == 0.0;
    if (limit == final_limit && change < kWeightTolerance) break;
  }
}

void FitRobust(const SplineModel& model, const TrajectoryScales& scales, FitMemory& memory,
               SplineFit& fit) {
  fit.weights.assign(model.measurements.size(), 1.0);
  Reweight(model, scales, 0.0, memory, fit);
}

MinimumReport Descend(const SplineModel& model, const TrajectoryScales& scales, FitMemory& memory,
                      SplineFit& fit) {
  constexpr int kMaxIterations = 300;
  constexpr double kNoStepM = 1e-8;
  const TruncatedLoss loss = LossOf(scales);
  MinimumReport report;
  bool has_factorised = false;
  while (!report.converged && report.iterations < kMaxIterations) {
    if (SetWeights(model, loss, fit) || !fit.is_minimum) {
      memory.solver.SetMeasurements(model, fit.weights);
      memory.solver.Factorise(Ratio(scales));
      fit.is_minimum = has_factorised = true;
    }
    report.converged = memory.solver.Step(model, fit.weights, fit.control_points_m) < kNoStepM;
    ++report.iterations;
  }
  if (has_factorised) memory.solver.Invert(fit.inverse);
  return report;
}

void AdoptMinimum(const SplineModel& model, const TrajectoryScales& scales, FitMemory& memory,
                  SplineFit& fit) {
  SetWeights(model, LossOf(scales), fit);
  memory.solver.SetMeasurements(model, fit.weights);
  memory.solver.Factorise(Ratio(scales));
  memory.solver.Invert(fit.inverse);
}

ScaleSearch SearchScales(const SplineModel& model, const SplineFit& fit,
                         const TrajectoryConfig& config, FitMemory& memory) {
  const double limit = Square(kOutlierSigmas);
  memory.solver.SetMeasurements(model, fit.weights);
  const double tau_s = model.acceleration_time_s;
  const double log_tau =
      0.5 * memory.solver.LogDeterminantOfSmoothness(model) -
      0.5 * Square(std::log(tau_s / kTypicalAccelerationTimeS) / kAccelerationTimeSpread);
  double used = 0.0;
  double outlier_cost = 0.0;  // makes the reweighted squares an upper bound of the loss
  for (const double weight : fit.weights) {
    used += weight;
    outlier_cost += limit * (1.0 - weight) / (1.0 + weight);
  }
  // Six parameters, first position and velocity, are nearly free. The acceleration has one per knot
  // between intervals.
  const double freedom = std::max(0.0, 3.0 * used - 6.0);
  const double smooth_rank = 3.0 * (model.num_control_points() - 2);

  constexpr double kNever = -std::numeric_limits<double>::infinity();
  auto& candidates = memory.candidates;
  candidates.clear();
  const double log_min_k = std::log(kMinNoiseScale);
  const double log_max_k = std::log(kMaxNoiseScale);
  const double log_min_a = std::log(kMinAccelerationMps2);
  const double log_max_a = std::log(kMaxAccelerationMps2);
  const double begin = log_min_a - log_max_k;
  const double end = log_max_a - log_min_k;
  const int num_ratios = 1 + static_cast<int>(std::ceil((end - begin) / kScaleStep));
  const int num_noises = 1 + static_cast<int>(std::ceil((log_max_k - log_min_k) / 0.1));
  // Adds the candidates of one ratio. Returns the best log posterior.
  const auto add_candidates = [&](int i) {
    const double log_ratio = begin + (end - begin) * i / (num_ratios - 1);
    const auto& control = memory.solver.Minimise(std::exp(log_ratio));
    double misfit = 0.0;
    for (const auto& row : model.start) misfit += Residual(row, control).squaredNorm();
    for (std::size_t m = 0; m < model.measurements.size(); ++m) {
      misfit += fit.weights[m] * Residual(model.measurements[m], control).squaredNorm();
    }
    double roughness = 0.0;
    for (const auto& row : model.smoothness) roughness += Residual(row, control).squaredNorm();
    misfit += roughness * std::exp(-2.0 * log_ratio);
    const double volume = 0.5 * memory.solver.LogDeterminant() + smooth_rank * log_ratio;
    double best = kNever;
    for (int k = 0; k < num_noises; ++k) {
      const double log_k = log_min_k + (log_max_k - log_min_k) * k / (num_noises - 1);
      const double log_a = log_ratio + log_k;
      if (log_a < log_min_a - 1e-9 || log_a > log_max_a + 1e-9) continue;
      const double prior =
          -0.5 * Square(log_k / kNoiseScaleSpread) -
          0.5 * Square((log_a - std::log(config.typical_acceleration_mps2)) / kAccelerationSpread);
      const double log_posterior = -freedom * log_k - 0.5 * misfit * std::exp(-2.0 * log_k) -
                                   volume - 0.5 * outlier_cost + prior;
      candidates.push_back({log_a, log_k, log_posterior});
      best = std::max(best, log_posterior);
    }
    return best;
  };
  // Every third ratio, then the neighbours of the likely ones: others contribute nothing.
  constexpr int kStride = 3;
  auto& bests = memory.bests;
  bests.assign(Index(num_ratios + kStride), kNever);
  for (int i = 0; i < num_ratios; i += kStride) bests[Index(i)] = add_candidates(i);
  const double least = *std::max_element(bests.begin(), bests.end()) - kNegligibleLog;
  for (int i = 0; i < num_ratios; ++i) {
    const int before = i - i % kStride;
    if (i != before && std::max(bests[Index(before)], bests[Index(before + kStride)]) > least) {
      add_candidates(i);
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
  return {{acceleration / sum, std::exp(log_noise / sum), tau_s}, best + std::log(sum) + log_tau};
}

}  // namespace unlidar
