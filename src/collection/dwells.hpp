// Dwells of a target before and after its flight.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"

namespace unlidar {

// Adds to a path the plots of a dwell that ends where and when the path begins (a drone that hovers
// over its pad before it climbs), and of one that begins where and when it ends. Plots are in order
// of time; frame, sensor, times, position and returns are used and set. Returns so near the ground
// are no evidence by themselves; where there are none while the target is elsewhere, they are the
// target's. `taken` (N): returns assigned to others.
void AddDwells(const Recording& recording, const std::vector<char>& taken, std::vector<Plot>* path);

}  // namespace unlidar
