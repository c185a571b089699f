// Times of the returns of a LiDAR that turns, from the order of its returns.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Sets the times of the returns of a frame from `begin_ns` to `end_ns`. Returns false, and leaves
// the times, if the order of the returns does not tell. It does where the azimuth grows, or falls,
// through one whole turn from the first return to the last: such returns stand in the order in
// which a LiDAR that turns fires. Returns ring by ring pass through many turns, other scans through
// none or back and forth.
// `points_m` (N): on the carrier of the sensor, in the order of the file. `times_ns` (N).
bool SetTimesOfTurn(const std::vector<Eigen::Vector3f>& points_m, const SensorConfig& sensor,
                    TimeNs begin_ns, TimeNs end_ns, std::vector<TimeNs>* times_ns);

}  // namespace unlidar
