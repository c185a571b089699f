#include "io/frame_pace.hpp"

#include <algorithm>

namespace unlidar {
namespace {

constexpr std::uint64_t kMaxOneIn = 1024;

}  // namespace

bool FramePace::Keeps(std::size_t sensor, std::optional<Clock::duration> waited,
                      Clock::time_point now) {
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

}  // namespace unlidar
