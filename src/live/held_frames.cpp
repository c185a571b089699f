#include "live/held_frames.hpp"

#include <map>

namespace unlidar {

bool HeldFrames::Has(std::uint32_t sensor, TimeNs time_ns) const {
  return std::any_of(held_.begin(), held_.end(), [&](const Held& held) {
    return held.frame.sensor == sensor && held.time_ns == time_ns;
  });
}

void HeldFrames::Add(CloudFrame frame, TimeNs time_ns) {
  points_ += frame.cloud.points_m.size();
  held_.push_back({time_ns, std::string(frame.name), std::move(frame)});
}

bool HeldFrames::TakeAt(HeldIterator position, Held* taken) {
  if (position == held_.end()) return false;
  *taken = std::move(*position);
  taken->frame.name = taken->name;
  points_ -= taken->frame.cloud.points_m.size();
  held_.erase(position);
  return true;
}

bool HeldFrames::IsOverfull() const {
  return held_.size() > kMaxFrames || (held_.size() > 1 && points_ > kMaxPoints);
}

HeldFrames::HeldIterator HeldFrames::OldestOfBusiestSensor() {
  std::map<std::uint32_t, std::size_t> cost;  // a frame without points also takes memory
  for (const Held& held : held_) {
    cost[held.frame.sensor] += held.frame.cloud.points_m.size() + kMaxPoints / kMaxFrames;
  }
  const auto most = std::max_element(
      cost.begin(), cost.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return std::find_if(held_.begin(), held_.end(),
                      [&](const Held& held) { return held.frame.sensor == most->first; });
}

}  // namespace unlidar
