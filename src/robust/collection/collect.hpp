// Going back for the rest: all returns of a target, once it is known where it flew.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "robust/plots/plots.hpp"
#include "robust/scene/sensor_view.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// The target of a path: its returns, and per frame their mean. `views`: (sensors). `excluded`
// returns (N) are left alone. Empty measurements where nothing fits.
Target CollectTarget(const Recording& recording, const std::vector<SensorView>& views,
                     const std::vector<Plot>& path, const std::vector<char>& excluded,
                     const CollectConfig& config, const TrajectoryConfig& trajectory_config);

}  // namespace unlidar
