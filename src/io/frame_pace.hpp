// Load shedding for frames that arrive in real time.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace unlidar {

// Overload: frames wait more than `max_extra_wait` longer than the shortest wait so far (a backlog
// present at the start is thus processed in full). Then one frame in two of each sensor is kept,
// evenly, then one in four and so on, until the wait is short.
class FramePace {
 public:
  using Clock = std::chrono::steady_clock;

  explicit FramePace(Clock::duration max_extra_wait) : max_extra_wait_(max_extra_wait) {}

  // True if the next frame of this sensor is to be processed. `waited`: time since its arrival;
  // empty for frames present before the program started.
  bool Keeps(std::size_t sensor, std::optional<Clock::duration> waited, Clock::time_point now);

  // One frame in one_in() is kept.
  std::uint64_t one_in() const { return one_in_; }

 private:
  Clock::duration max_extra_wait_;
  std::optional<Clock::duration> shortest_wait_;
  std::optional<Clock::time_point> changed_;
  std::uint64_t one_in_ = 1;
  std::vector<std::uint64_t> seen_;  // number of frames of each sensor
};

}  // namespace unlidar
