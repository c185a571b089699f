#include "live/recent_frame_times.hpp"

#include <algorithm>

namespace unlidar {

void RecentFrameTimes::Add(std::uint32_t frame, const FrameTime& at) {
  frames_.push_back({frame, at.time_s, at.sensor, num_forgotten_ + counts_.size(),
                     at.frames_before.size(), at.viewpoint_m});
  for (const std::uint32_t before : at.frames_before) counts_.push_back(before);
}

FrameTime RecentFrameTimes::At(std::uint32_t frame) const {
  const auto its =
      std::lower_bound(frames_.begin(), frames_.end(), frame,
                       [](const Frame& a, std::uint32_t number) { return a.number < number; });
  const auto first =
      counts_.begin() + static_cast<std::ptrdiff_t>(its->first_count - num_forgotten_);
  return {its->time_s,
          {first, first + static_cast<std::ptrdiff_t>(its->num_sensors)},
          its->sensor,
          its->viewpoint_m};
}

void RecentFrameTimes::Forget(std::uint32_t frame) {
  for (; !frames_.empty() && frames_.front().number < frame; frames_.pop_front()) {
    for (std::size_t i = 0; i < frames_.front().num_sensors; ++i) counts_.pop_front();
    num_forgotten_ += frames_.front().num_sensors;
  }
}

}  // namespace unlidar
