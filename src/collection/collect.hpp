// Collection of all returns of a target along its fitted trajectory. method.md section 7.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/station_model.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Uncertainty of the distance of the centre behind the mean of the returns, as a share of their
// spread: flat bodies have 0.2 to 0.4, the drone of seq0001 0.55, a sphere 1.33, and which of them
// a target is nobody told. 0.5 is their root mean square about the default of 0.4.
constexpr double kFacingSideSigma = 0.5;

// Returns the target of a path: its returns and their mean per frame, without a trajectory.
// `station_models`: (sensors). `excluded` (N): returns that are not assigned. Measurements are
// empty if no return fits.
Target CollectTarget(const Recording& recording, const std::vector<StationModel>& station_models,
                     const std::vector<Plot>& path, const std::vector<char>& excluded,
                     const RobustConfig& robust, const TrajectoryConfig& trajectory_config);

}  // namespace unlidar
