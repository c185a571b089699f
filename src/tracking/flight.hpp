// Whether a path of plots is that of a drone, beside its score.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/rejection.hpp"
#include "tracking/tracker.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Evidence in so many frames: two plots of one frame are no two pieces of it.
bool HasMinFrames(const std::vector<Plot>& path, int min_frames);

// How high above the ground a path must be to fly, for people and cars never are: less where its
// returns show that it is no part of a body that stands below it. What is there anyway is no
// body's: the returns of the recording tell, if it has any.
double MinFlightHeightM(const Recording& recording, const std::vector<Plot>& path,
                        const RobustConfig& config);

// kNone for what was seen often enough, is off the ground and returns as much as a drone does. Of
// the recording the sensors and frames count, which may be those about the path only.
Rejection FlightRejection(const Recording& recording, const ScanSchedule& scan_schedule,
                          const std::vector<Plot>& path, const RobustConfig& config);

}  // namespace unlidar
