// What the search finds where nothing flies.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/tracker.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// The best score that the search reaches in the clutter of a recording with the frames of each
// sensor in random order, which no motion survives: a permutation null. 0 if it finds no path. The
// order is the same whenever the recording is. `are_clutter` (plots): those that no target
// explains.
double NullScore(const Recording& recording, const std::vector<Plot>& plots,
                 const std::vector<char>& are_clutter, const ScanSchedule& scan_schedule,
                 const TrackerConfig& config);

}  // namespace unlidar
