// Keeping up with frames that come by the wall clock.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace unlidar {

// Frames are overloaded where they wait for longer and longer: by more than `max_extra_wait` above
// the shortest wait so far (a backlog that was there at the start is worked off in whole). Then one
// frame in two of each sensor is kept, evenly, or in four and so on, until the wait is short.
class FramePace {
 public:
  using Clock = std::chrono::steady_clock;

  explicit FramePace(Clock::duration max_extra_wait) : max_extra_wait_(max_extra_wait) {}

  // Whether the next frame of this sensor, which has waited so long, is to be worked off. Empty for
  // one that was there before the program.
  bool Keeps(std::size_t sensor, std::optional<Clock::duration> waited, Clock::time_point now);

  // One frame in so many is kept.
  std::uint64_t one_in() const { return one_in_; }

 private:
  void Adapt(Clock::duration waited, Clock::time_point now);

  Clock::duration max_extra_wait_;
  std::optional<Clock::duration> shortest_wait_;
  std::optional<Clock::time_point> changed_;
  std::uint64_t one_in_ = 1;
  std::vector<std::uint64_t> seen_;  // frames of each sensor
};

}  // namespace unlidar
