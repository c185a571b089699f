// Arrival time by the clocks of this computer.
#pragma once

#include <chrono>

#include "unlidar/types.hpp"

namespace unlidar {

// Known for live sources only: results of --stdin do not depend on it.
struct Arrival {
  TimeNs unix_ns = 0;
  TimeNs steady_ns = 0;  // monotonic, never set
};

// Returns nanoseconds since the epoch of the clock; Unix time for the system clock.
template <class TimePoint>
TimeNs NsSinceEpoch(TimePoint at) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(at.time_since_epoch()).count();
}

}  // namespace unlidar
