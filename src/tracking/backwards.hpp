// Time that runs the other way: what a search finds from its end to its beginning.
#pragma once

#include "tracking/tracker.hpp"

namespace unlidar {

// Without overflow. Backwards of backwards is forwards.
inline TimeNs Backwards(TimeNs time_ns) { return ~time_ns; }

Watch Backwards(Watch watch);

// Without its returns: no search looks at them.
Plot Backwards(const Plot& plot);

}  // namespace unlidar
