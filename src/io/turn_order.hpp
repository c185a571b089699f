// Times of the returns of a LiDAR that turns, from the order of its returns.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace unlidar {

// Sets the share of the frame, 0 to 1, that had passed when each return was measured; none if the
// order does not tell. It does where the azimuth grows, or falls, through one whole turn from the
// first return to the last: such returns stand in the order in which a LiDAR that turns fires.
// Returns ring by ring pass through many turns, other scans through none or back and forth.
// `rows`: in the axes of the sensor, in the order of the file. `return_rows` (N): those that are
// returns, ascending. `shares` (N).
void FindTurnShares(const std::vector<Eigen::Vector3f>& rows,
                    const std::vector<std::uint32_t>& return_rows, std::vector<float>* shares);

}  // namespace unlidar
