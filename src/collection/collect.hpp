// Going back for the rest: all returns of a target, once it is known where it flew.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/station_model.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// The mean of a frame's returns wanders by so much per axis, as other parts of the body are hit.
constexpr double kCentreSigmaM = 0.04;
// Spread of a return by the width of its beam, per metre of range.
constexpr double kBeamSigmaRad = 0.002;
// How well it is known by which share of the spread the centre lies behind the returns: flat bodies
// have 0.2 to 0.4, the drone of seq0001 0.55.
constexpr double kFacingSideSigma = 0.3;

// The target of a path: its returns, and per frame their mean. `station_models`: (sensors).
// `excluded` returns (N) are left alone. Empty measurements where nothing fits.
Target CollectTarget(const Recording& recording, const std::vector<StationModel>& station_models,
                     const std::vector<Plot>& path, const std::vector<char>& excluded,
                     const RobustConfig& robust, const TrajectoryConfig& trajectory_config);

}  // namespace unlidar
