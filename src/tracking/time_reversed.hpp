// Reversal of time, for searches from the end to the beginning.
#pragma once

#include "scene/plots.hpp"
#include "tracking/scan_schedule.hpp"

namespace unlidar {

// Reverses the order of times without overflow; its own inverse.
inline TimeNs TimeReversed(TimeNs time_ns) { return ~time_ns; }

ScanSchedule TimeReversed(ScanSchedule scan_schedule);

// Drops the returns, which no search uses.
Plot TimeReversed(const Plot& plot);

}  // namespace unlidar
