// Null distribution of the track score.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/tracker.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Returns the best score in the clutter of a recording with the frames of each sensor in random
// order, which no motion survives: a permutation null. 0 if no path is found. The order is
// deterministic for a given recording. `are_clutter` (plots): 1 for plots that no target explains.
// method.md (10).
double NullScore(const Recording& recording, const std::vector<Plot>& plots,
                 const std::vector<char>& are_clutter, const ScanSchedule& scan_schedule,
                 const TrackerConfig& config);

}  // namespace unlidar
