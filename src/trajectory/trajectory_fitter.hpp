// Fits trajectories one after the other, reusing memory.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {

// Levels of sigma_a over that of the whole flight: an eighth to four, in half octaves.
inline constexpr int kAgilityLevels = 11;

// Driving noise of the acceleration in an interval, in units of the variance of the whole flight.
struct DrivingNoise {
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();    // of the fitted jerk
  Eigen::Matrix3d unknown = Eigen::Matrix3d::Zero();    // posterior covariance of the jerk
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // of flight; shorter if slow
};

// Buffers of the fit of a time-varying, anisotropic agility: targets are calm for most of a flight
// and agile for some seconds, and accelerate more along their direction than across it. A single
// sigma_a would be too wide for calm flight and far too narrow for manoeuvres. One entry per
// interval, kept for reuse.
struct AgilityMemory {
  using Levels = Eigen::Array<double, kAgilityLevels, 1>;
  std::vector<DrivingNoise> driving_noises;
  std::vector<Levels> likelihoods;
  std::vector<Levels> forward;
  std::vector<double> stay_probabilities;
  std::array<std::vector<double>, 3> variances;  // of each spread
};

// Solver of the final robust minimum. Ceres allocates at each fit.
enum class Minimiser { kBanded, kCeres };

// A fit no longer than an earlier one does not allocate, nor does `trajectory` if it is that of the
// same target one frame earlier.
class TrajectoryFitter {
 public:
  explicit TrajectoryFitter(const TrajectoryConfig& config,
                            Minimiser minimiser = Minimiser::kBanded,
                            int max_ceres_iterations = 500)
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
