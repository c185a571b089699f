// When something came, by the clocks of this computer.
#pragma once

#include <chrono>

#include "unlidar/types.hpp"

namespace unlidar {

// Only live sources have such a time: what --stdin gives does not depend on it.
struct Arrival {
  TimeNs unix_ns = 0;
  TimeNs steady_ns = 0;  // that nobody sets
};

// Of a clock's epoch: Unix time of the system's clock.
template <class TimePoint>
TimeNs NsSinceEpoch(TimePoint at) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(at.time_since_epoch()).count();
}

}  // namespace unlidar
