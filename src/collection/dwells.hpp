// Where a target stood before it flew, and after.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"

namespace unlidar {

// Adds to a path, plots in order of time of which each has its frame, sensor, times, position and
// returns, those of a dwell that ends where and when the path begins (a drone that hovers over its
// pad before it climbs), and of one that begins where and when it ends. What is so near the ground
// is no evidence by itself. But where nothing is seen while the target is elsewhere, it is the
// target's. `taken` (N): returns that are others'.
void AddDwells(const Recording& recording, const std::vector<char>& taken, std::vector<Plot>* path);

}  // namespace unlidar
