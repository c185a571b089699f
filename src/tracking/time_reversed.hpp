// Time that runs the other way: what a search finds from its end to its beginning.
#pragma once

#include "tracking/tracker.hpp"

namespace unlidar {

// Without overflow. TimeReversed of backwards is forwards.
inline TimeNs TimeReversed(TimeNs time_ns) { return ~time_ns; }

ScanSchedule TimeReversed(ScanSchedule scan_schedule);

// Without its returns: no search looks at them.
Plot TimeReversed(const Plot& plot);

}  // namespace unlidar
