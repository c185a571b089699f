// The cross-section of what returns as the plots of a path.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"

namespace unlidar {

// Returns the cross-section about each plot of a path, of the sensor that sees the largest: the
// area across the ray that returns what meets it, the number of returns over that of lines of sight
// per m^2, within three seconds. A target may be hidden during pauses, so only frames close in time
// to a plot count. Uses the sensors and frames of the recording, which may be only those about the
// path.
std::vector<double> CrossSectionsM2(const Recording& recording, const std::vector<Plot>& path);

}  // namespace unlidar
