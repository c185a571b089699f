// Arrival of frames by the clocks of this computer, and what is left out where they come too fast.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Arrival of a frame; known for live sources only: results of --stdin do not depend on it.
struct Arrival {
  TimeNs unix_ns = 0;
  TimeNs steady_ns = 0;  // monotonic, never set
};

// Returns nanoseconds since the epoch of the clock; Unix time for the system clock.
template <class TimePoint>
TimeNs NsSinceEpoch(TimePoint at) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(at.time_since_epoch()).count();
}

// Overload: frames wait more than `max_extra_wait` longer than the shortest wait so far (a backlog
// present at the start is thus processed in full). Then one frame in two of each sensor is kept,
// evenly, then one in four and so on, until the wait is short.
class FramePace {
 public:
  using Clock = std::chrono::steady_clock;

  explicit FramePace(Clock::duration max_extra_wait) : max_extra_wait_(max_extra_wait) {}

  // True if the next frame of this sensor is to be processed. `waited`: time since its arrival;
  // empty for frames present before the program started.
  bool Keeps(std::size_t sensor, std::optional<Clock::duration> waited, Clock::time_point now) {
    if (waited) shortest_wait_ = std::min(shortest_wait_.value_or(*waited), *waited);
    // A change takes effect with a delay.
    const bool has_settled = !changed_ || now - *changed_ >= max_extra_wait_ / 2;
    if (waited && has_settled) {
      const Clock::duration excess = *waited - *shortest_wait_;
      const std::uint64_t before = one_in_;
      if (excess > max_extra_wait_ && one_in_ < kMaxOneIn) one_in_ *= 2;
      if (excess < max_extra_wait_ / 4 && one_in_ > 1) one_in_ /= 2;
      if (one_in_ != before) changed_ = now;
    }
    if (seen_.size() <= sensor) seen_.resize(sensor + 1);
    return seen_[sensor]++ % one_in_ == 0;
  }

  std::uint64_t one_in() const { return one_in_; }

 private:
  static constexpr std::uint64_t kMaxOneIn = 1024;

  Clock::duration max_extra_wait_;
  std::optional<Clock::duration> shortest_wait_;
  std::optional<Clock::time_point> changed_;
  std::uint64_t one_in_ = 1;
  std::vector<std::uint64_t> seen_;  // number of frames of each sensor
};

}  // namespace unlidar
