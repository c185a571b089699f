#include "live/waiting_frames.hpp"

#include <algorithm>
#include <map>

namespace unlidar {
namespace {

template <class Value>
std::size_t BytesOf(const std::vector<Value>& values) {
  return values.capacity() * sizeof(Value);
}

std::size_t BytesOf(const LoadedFrame& frame) {
  const PcdCloud& cloud = frame.cloud;
  return BytesOf(cloud.points_m) + BytesOf(cloud.integer_times) + BytesOf(cloud.floating_times) +
         BytesOf(frame.return_rows) + BytesOf(frame.points_m) + BytesOf(frame.times_ns);
}

// The sensor with the highest cost. A frame without points also takes memory.
using CostBySensor = std::map<std::uint32_t, std::size_t>;
std::uint32_t BusiestOf(const CostBySensor& cost) {
  const auto is_less = [](const auto& a, const auto& b) { return a.second < b.second; };
  return std::max_element(cost.begin(), cost.end(), is_less)->first;
}

}  // namespace

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

bool HeldFrames::TakeEarliest(const Condition& is_due, Held* taken) {
  HeldIterator earliest = held_.end();
  for (HeldIterator at = held_.begin(); at != held_.end(); ++at) {
    const bool is_earlier =
        earliest == held_.end() || std::make_pair(at->time_ns, at->frame.sensor) <
                                       std::make_pair(earliest->time_ns, earliest->frame.sensor);
    if (is_earlier && is_due(at->frame.sensor, at->time_ns)) earliest = at;
  }
  return TakeAt(earliest, taken);
}

bool HeldFrames::TakeOverflow(const Condition& should_drop, Held* taken) {
  const HeldIterator found = std::find_if(held_.begin(), held_.end(), [&](const Held& held) {
    return should_drop(held.frame.sensor, held.time_ns);
  });
  if (found != held_.end()) return TakeAt(found, taken);
  const bool is_overfull = held_.size() > kMaxFrames || (held_.size() > 1 && points_ > kMaxPoints);
  return is_overfull && TakeAt(OldestOfBusiestSensor(), taken);
}

HeldFrames::HeldIterator HeldFrames::OldestOfBusiestSensor() {
  CostBySensor cost;
  for (const Held& held : held_) {
    cost[held.frame.sensor] += held.frame.cloud.points_m.size() + kMaxPoints / kMaxFrames;
  }
  return std::find_if(held_.begin(), held_.end(), [busiest = BusiestOf(cost)](const Held& held) {
    return held.frame.sensor == busiest;
  });
}

LoadedFrame& WaitingFrames::Next() {
  if (num_waiting_ == slots_.size()) slots_.emplace_back();
  return slots_[num_waiting_].frame;
}

void WaitingFrames::Add(TimeNs time_ns) {
  Slot& slot = slots_[num_waiting_];
  slot.time_ns = time_ns;
  bytes_ -= slot.bytes;
  slot.bytes = BytesOf(slot.frame);
  bytes_ += slot.bytes;
  ++num_waiting_;
  std::push_heap(slots_.begin(), end(), ComesLater);
}

LoadedFrame* WaitingFrames::TakeEarliest() {
  std::pop_heap(slots_.begin(), end(), ComesLater);
  --num_waiting_;
  return &slots_[num_waiting_].frame;
}

bool WaitingFrames::IsOverfull() const {
  return num_waiting_ > kMaxFrames || (num_waiting_ > 1 && bytes_ > kMaxBytes);
}

std::optional<LoadedFrame> WaitingFrames::TakeOverflow() {
  if (!IsOverfull()) return std::nullopt;
  for (; slots_.size() > num_waiting_; slots_.pop_back()) bytes_ -= slots_.back().bytes;
  if (!IsOverfull()) return std::nullopt;
  std::iter_swap(NewestOfBusiestSensor(), slots_.end() - 1);
  Slot taken = std::move(slots_.back());
  bytes_ -= taken.bytes;
  slots_.pop_back();
  --num_waiting_;
  std::make_heap(slots_.begin(), end(), ComesLater);
  return std::move(taken.frame);
}

WaitingFrames::Slots::iterator WaitingFrames::NewestOfBusiestSensor() {
  CostBySensor cost;
  for (const Slot& slot : slots_) {
    cost[slot.frame.info.sensor] += slot.bytes + kMaxBytes / kMaxFrames;
  }
  const auto rank = [busiest = BusiestOf(cost)](const Slot& slot) {
    return std::make_pair(slot.frame.info.sensor == busiest, slot.time_ns);
  };
  return std::max_element(slots_.begin(), slots_.end(),
                          [&](const Slot& a, const Slot& b) { return rank(a) < rank(b); });
}

std::vector<LoadedFrame> WaitingFrames::TakeAll() {
  slots_.resize(num_waiting_);
  std::sort(slots_.begin(), slots_.end(),
            [](const Slot& a, const Slot& b) { return ComesLater(b, a); });
  std::vector<LoadedFrame> frames;
  frames.reserve(slots_.size());
  for (Slot& slot : slots_) frames.push_back(std::move(slot.frame));
  slots_.clear();
  num_waiting_ = bytes_ = 0;
  return frames;
}

}  // namespace unlidar
