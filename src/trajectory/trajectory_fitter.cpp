#include "trajectory/trajectory_fitter.hpp"

#include <array>
#include <utility>

#include "base/maths.hpp"

namespace unlidar {

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
