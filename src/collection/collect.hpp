// Collection of all returns of a target along its fitted trajectory. method.md section 7.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/stations.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Returns the target of a path: its returns and their mean per frame, without a trajectory.
// `station_models`: (sensors). `excluded` (N): returns that are not assigned. Measurements are
// empty if no return fits.
Target CollectTarget(const Recording& recording, const std::vector<StationModel>& station_models,
                     const std::vector<Plot>& path, const std::vector<char>& excluded,
                     const RobustConfig& robust, const TrajectoryConfig& trajectory_config);

}  // namespace unlidar
