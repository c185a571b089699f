// Trajectories of single fits, for tests and benchmarks.
#pragma once

#include <vector>

#include "trajectory/trajectory_fitter.hpp"

namespace unlidar {

inline Trajectory FitTrajectory(const std::vector<Measurement>& measurements,
                                const TrajectoryConfig& config) {
  Trajectory trajectory;
  TrajectoryFitter(config).Fit(measurements, trajectory);
  return trajectory;
}

inline Trajectory RefitTrajectory(const std::vector<Measurement>& measurements,
                                  const TrajectoryScales& scales, const TrajectoryConfig& config) {
  Trajectory trajectory;
  TrajectoryFitter(config).Refit(measurements, scales, trajectory);
  return trajectory;
}

}  // namespace unlidar
