// Fits trajectories one after the other, reusing memory.
#pragma once

#include <vector>

#include "trajectory/agility.hpp"
#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {

// Solver of the final robust minimum. Ceres allocates at each fit.
enum class Minimiser { kBanded, kCeres };
inline constexpr int kMaxCeresIterations = 500;

// A fit no longer than an earlier one does not allocate, nor does `trajectory` if it is that of the
// same target one frame earlier.
class TrajectoryFitter {
 public:
  explicit TrajectoryFitter(const TrajectoryConfig& config,
                            Minimiser minimiser = Minimiser::kBanded,
                            int max_ceres_iterations = kMaxCeresIterations)
      : config_(config), minimiser_(minimiser), max_ceres_iterations_(max_ceres_iterations) {}

  // Fits measurements: at least one, in time order, with positive definite covariances. Throws
  // std::invalid_argument otherwise.
  void Fit(const std::vector<Measurement>& measurements, Trajectory& trajectory);

  // Same at given scales, several times faster: for measurements that have changed little.
  void Refit(const std::vector<Measurement>& measurements, TrajectoryScales scales,
             Trajectory& trajectory);

 private:
  void SetAccelerationTime(double acceleration_time_s);
  ScaleSearch SearchScalesOfTypicalTime();
  ScaleSearch SearchAccelerationTimes();
  void Finish(const std::vector<Measurement>& measurements, const TrajectoryScales& scales,
              Trajectory& trajectory);

  MinimumReport FindMinimum(const TrajectoryScales& scales);

  TrajectoryConfig config_;
  Minimiser minimiser_;
  int max_ceres_iterations_;
  SplineModel model_;
  SplineFit fit_;
  ScaleSearch searched_;                  // at the typical tau, for
  std::vector<double> searched_weights_;  // these; empty: none
  FitMemory memory_;
  AgilityMemory agility_memory_;
};

}  // namespace unlidar
