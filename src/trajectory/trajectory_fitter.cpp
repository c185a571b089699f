#include "trajectory/trajectory_fitter.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "base/maths.hpp"
#include "trajectory/banded.hpp"

namespace unlidar {
namespace {

constexpr int kLowestLevel = -6;
constexpr double kHoldingTimeS = 0.5;
constexpr std::array<double, 3> kSpreads = {0.25, 0.5, 1.0};  // of the logarithm of sigma_a

using Levels = AgilityMemory::Levels;

Levels LogVariances() {
  return Levels::LinSpaced(kLowestLevel, kLowestLevel + kAgilityLevels - 1) * std::log(2.0);
}

// Below this speed the direction is ill-defined.
constexpr double kMinSpeedMps = 0.5;
// Weight of the prior that the variances along and across the direction are equal, in degrees of
// freedom.
constexpr double kPriorFreedom = 10.0;

// Sum over the two rows of an interval.
DrivingNoise DrivingNoiseOf(const SplineModel& model, std::size_t interval, const SplineFit& fit,
                            const TrajectoryScales& scales) {
  DrivingNoise driving_noise;
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
  for (const std::size_t i : {2 * interval + 1, 2 * interval + 2}) {
    const Eigen::Vector4d& basis = model.smoothness[i].basis;
    const int first = model.smoothness[i].first;
    Eigen::Vector3d value = Eigen::Vector3d::Zero();
    for (int a = 0; a < 4; ++a) {
      const Eigen::Vector3d& point_m = fit.control_points_m[Index(first + a)];
      value += basis[a] * point_m;
      velocity_mps += 0.5 * model.derivatives[i].velocity[a] * point_m;
    }
    driving_noise.squares += value * value.transpose();
    driving_noise.unknown += Square(scales.noise) * CovarianceOfSum(first, basis, fit.inverse);
  }
  const double variance = Square(scales.acceleration_mps2);
  driving_noise.squares /= variance;
  driving_noise.unknown /= variance;
  driving_noise.direction =
      velocity_mps / std::sqrt(velocity_mps.squaredNorm() + Square(kMinSpeedMps));
  return driving_noise;
}

double Dot(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) { return a.cwiseProduct(b).sum(); }

// Ratio of the variance along the direction to that across it, each the fitted squares over their
// degrees of freedom.
double AlongOverAcross(const std::vector<DrivingNoise>& driving_noises,
                       const std::vector<Eigen::Matrix3d>& agility) {
  double along = kPriorFreedom;
  double across = kPriorFreedom;
  double along_freedom = kPriorFreedom;
  double across_freedom = kPriorFreedom;
  for (std::size_t i = 0; i < driving_noises.size(); ++i) {
    const DrivingNoise& driving_noise = driving_noises[i];
    const double share = driving_noise.direction.squaredNorm();
    if (share == 0.0) continue;
    const Eigen::Matrix3d along_projector =
        driving_noise.direction * driving_noise.direction.transpose() / share;
    const Eigen::Matrix3d across_projector = Eigen::Matrix3d::Identity() - along_projector;
    const Eigen::Matrix3d prior = agility[i] * agility[i];
    const double level = prior.trace() / 3.0;
    along += share * Dot(along_projector, driving_noise.squares) / level;
    across += share * Dot(across_projector, driving_noise.squares) / level;
    along_freedom += share * std::clamp(1.0 - Dot(along_projector, driving_noise.unknown) /
                                                  Dot(along_projector, prior),
                                        0.0, 1.0);
    across_freedom += share * std::clamp(2.0 - 2.0 * Dot(across_projector, driving_noise.unknown) /
                                                   Dot(across_projector, prior),
                                         0.0, 2.0);
  }
  return along / along_freedom * across_freedom / across;
}

// Returns the standard deviations along and across the direction with a mean variance per axis of
// 1, as a symmetric matrix, or its inverse.
Eigen::Matrix3d AnisotropicSigmas(const Eigen::Vector3d& direction, double along_over_across,
                                  bool is_inverse) {
  const double share = direction.squaredNorm();
  const double ratio = 1.0 + (along_over_across - 1.0) * share;
  double across = std::sqrt(3.0 / (ratio + 2.0));
  double along = std::sqrt(ratio) * across;
  if (is_inverse) {
    across = 1.0 / across;
    along = 1.0 / along;
  }
  Eigen::Matrix3d along_projector = Eigen::Matrix3d::Zero();
  if (share > 0.0) along_projector = direction * direction.transpose() / share;
  return across * Eigen::Matrix3d::Identity() + (along - across) * along_projector;
}

// Sets the posterior means of the variances (intervals) under the hidden Markov chain. Returns its
// log evidence.
double ForwardBackward(AgilityMemory& memory, std::size_t which) {
  const std::vector<Levels>& likelihoods = memory.likelihoods;
  const std::vector<double>& stay_probabilities = memory.stay_probabilities;
  const double spread = kSpreads[which];
  Levels prior = (-0.5 * (0.5 * LogVariances() / spread).square()).exp();
  prior /= prior.sum();
  const std::size_t n = likelihoods.size();
  double log_evidence = 0.0;
  std::vector<Levels>& forward = memory.forward;
  forward.resize(n);
  Levels expected = prior;
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0)
      expected = stay_probabilities[i] * forward[i - 1] + (1.0 - stay_probabilities[i]) * prior;
    forward[i] = likelihoods[i] * expected;
    log_evidence += std::log(forward[i].sum());
    forward[i] /= forward[i].sum();
  }
  memory.variances[which].resize(n);
  Levels backward = Levels::Ones();
  const Levels variances = LogVariances().exp();
  for (std::size_t i = n; i-- > 0;) {
    const Levels posterior = forward[i] * backward;
    memory.variances[which][i] = (posterior * variances).sum() / posterior.sum();
    const Levels later = likelihoods[i] * backward;
    backward =
        stay_probabilities[i] * later + (1.0 - stay_probabilities[i]) * (prior * later).sum();
    backward /= backward.sum();
  }
  return log_evidence;
}

// Sets the agility of each interval of the model (sigma_a there over that of the whole flight) to
// its posterior mean after a fit at the present agilities. The agility is a hidden Markov chain on
// a ladder of levels: a level is kept for half a second on average, and is then drawn anew. The
// spread of the levels is averaged over by the evidence for each spread; a uniform flight keeps its
// level. The evidence of an interval is the part of its jerks that the measurements determine
// (MacKay, 1992): none in a gap, where the agility is that of its ends and, farther off, the prior.
// The ratio of the variances along and across the direction is one number per flight, estimated
// from the same parts; a hover has no direction.
void AdaptAgility(const SplineFit& fit, const TrajectoryScales& scales,
                  const TrajectoryConfig& config, AgilityMemory& memory, SplineModel& model) {
  const Levels log_variances = LogVariances();
  const std::size_t n = model.agility.size();
  std::vector<DrivingNoise>& driving_noises = memory.driving_noises;
  driving_noises.resize(n);
  memory.likelihoods.resize(n);
  memory.stay_probabilities.resize(n);
  for (std::size_t i = 0; i < n; ++i) driving_noises[i] = DrivingNoiseOf(model, i, fit, scales);
  const double along_over_across =
      config.Uses(MotionRule::kDirection) ? AlongOverAcross(driving_noises, model.agility) : 1.0;
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Matrix3d whiten =
        AnisotropicSigmas(driving_noises[i].direction, along_over_across, true);
    const double fitted = Dot(whiten * whiten, driving_noises[i].squares);
    const Eigen::Matrix3d prior = model.agility[i] * model.agility[i];
    const double measured =
        std::clamp(3.0 - Dot(prior.inverse(), driving_noises[i].unknown), 0.0, 3.0);
    const Levels log_likelihood =
        -0.5 * (measured * log_variances + fitted * (-log_variances).exp());
    memory.likelihoods[i] = (log_likelihood - log_likelihood.maxCoeff()).exp();
    const double step_s = 0.5 * (model.knots_s[i + 4] - model.knots_s[i + 2]);
    memory.stay_probabilities[i] = std::exp(-step_s / kHoldingTimeS);
  }
  std::array<double, kSpreads.size()> shares;
  for (std::size_t s = 0; s < shares.size(); ++s) shares[s] = ForwardBackward(memory, s);
  const double best = *std::max_element(shares.begin(), shares.end());
  double sum = 0.0;
  for (double& share : shares) {
    share = std::exp(share - best);
    sum += share;
  }
  for (std::size_t i = 0; i < n; ++i) {
    double variance = 0.0;
    for (std::size_t s = 0; s < shares.size(); ++s) variance += shares[s] * memory.variances[s][i];
    const double level = std::sqrt(variance / sum);
    const Eigen::Vector3d& direction = driving_noises[i].direction;
    model.agility[i] = level * AnisotropicSigmas(direction, along_over_across, false);
    const Eigen::Matrix3d inverse = AnisotropicSigmas(direction, along_over_across, true);
    for (const std::size_t row : {2 * i + 1, 2 * i + 2}) {
      model.smoothness[row].sqrt_information = inverse / level;
    }
  }
}

}  // namespace

void TrajectoryFitter::Fit(const std::vector<Measurement>& measurements, Trajectory& trajectory) {
  // Scales and outliers depend on each other: several starts, the most likely pair wins.
  constexpr std::array<double, 3> kStartsMps2 = {1.0, 5.0, 25.0};
  BuildSplineModel(measurements, config_, model_);
  SetAccelerationTime(kTypicalAccelerationTimeS);
  searched_weights_.clear();
  ScaleSearch best;
  for (const double start_mps2 : kStartsMps2) {
    FitRobust(model_, {start_mps2, 1.0}, memory_, fit_);
    const ScaleSearch found = SearchScalesOfTypicalTime();
    if (start_mps2 == kStartsMps2.front() || found.log_evidence > best.log_evidence) best = found;
  }
  FitRobust(model_, best.scales, memory_, fit_);
  if (config_.Uses(MotionRule::kAccelerationTime)) best = SearchAccelerationTimes();
  SetAccelerationTime(best.scales.acceleration_time_s);
  FitRobust(model_, best.scales, memory_, fit_);
  Finish(measurements, best.scales, trajectory);
}

void TrajectoryFitter::Refit(const std::vector<Measurement>& measurements, TrajectoryScales scales,
                             Trajectory& trajectory) {
  BuildSplineModel(measurements, config_, model_);
  SetAccelerationTime(scales.acceleration_time_s);
  FitRobust(model_, scales, memory_, fit_);
  Finish(measurements, scales, trajectory);
}

void TrajectoryFitter::SetAccelerationTime(double acceleration_time_s) {
  SetSmoothness(acceleration_time_s, model_);
  memory_.solver.SetSmoothness(model_);
}

// Scales depend on a fit by its weights alone, and most starts lead to the same.
ScaleSearch TrajectoryFitter::SearchScalesOfTypicalTime() {
  if (fit_.weights != searched_weights_) {
    searched_weights_ = fit_.weights;
    searched_ = SearchScales(model_, fit_, config_, memory_);
  }
  return searched_;
}

// Returns the scales at the most likely tau for the weights of the present fit: starting from the
// typical tau, it is halved or doubled while that is likelier.
ScaleSearch TrajectoryFitter::SearchAccelerationTimes() {
  constexpr double kMaxFactor = 4.0;  // of the typical tau, either way
  const double typical_s = model_.acceleration_time_s;
  ScaleSearch best = SearchScalesOfTypicalTime();
  for (const double factor : {0.5, 2.0}) {
    for (double time_s = factor * typical_s;
         time_s <= kMaxFactor * typical_s && kMaxFactor * time_s >= typical_s; time_s *= factor) {
      SetAccelerationTime(time_s);
      const ScaleSearch found = SearchScales(model_, fit_, config_, memory_);
      if (!(found.log_evidence > best.log_evidence)) break;
      best = found;
    }
    if (best.scales.acceleration_time_s != typical_s) break;
  }
  return best;
}

// Ceres starts where the reweighting ended and removes its rounding errors. If it does not
// converge, the minimum of the banded solver is used, as for a stream.
MinimumReport TrajectoryFitter::FindMinimum(const TrajectoryScales& scales) {
  if (minimiser_ == Minimiser::kBanded) return Descend(model_, scales, memory_, fit_);
  if (fit_.is_minimum) memory_.solver.Step(model_, fit_.weights, fit_.control_points_m);
  std::vector<Eigen::Vector3d> control_points_m = fit_.control_points_m;
  MinimumReport report =
      MinimiseByCeres(model_, scales, LossOf(scales), max_ceres_iterations_, control_points_m);
  if (report.converged) {
    fit_.control_points_m = std::move(control_points_m);
    AdoptMinimum(model_, scales, memory_, fit_);
    report.solver = "ceres";
  } else {
    Descend(model_, scales, memory_, fit_);
  }
  return report;
}

// Starts from a fit with constant agility.
void TrajectoryFitter::Finish(const std::vector<Measurement>& measurements,
                              const TrajectoryScales& scales, Trajectory& trajectory) {
  constexpr int kRounds = 2;  // a third changes sigmas by 1 %
  for (int round = 0; config_.Uses(MotionRule::kAgility) && round < kRounds; ++round) {
    AdaptAgility(fit_, scales, config_, agility_memory_, model_);
    memory_.solver.SetSmoothness(model_);
    Reweight(model_, scales, LossOf(scales).squared_limit, memory_, fit_);
  }
  trajectory.minimum = FindMinimum(scales);
  trajectory.scales = scales;
  trajectory.origin_ns = measurements.front().time_ns;
  trajectory.duration_ns = measurements.back().time_ns - trajectory.origin_ns;
  trajectory.origin_m = model_.origin_m;
  trajectory.knots_s = model_.knots_s;
  trajectory.agility = model_.agility;
  trajectory.control_points_m = fit_.control_points_m;
  trajectory.weights = fit_.weights;
  trajectory.covariance_m2 = fit_.inverse;
  for (auto& column : trajectory.covariance_m2) column *= Square(scales.noise);
}

}  // namespace unlidar
