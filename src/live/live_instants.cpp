#include "live/live_instants.hpp"

#include <algorithm>
#include <variant>

namespace unlidar {
namespace {

// No track continues through a longer pause: twice the largest robust.tracker.max_gap_s.
constexpr TimeNs kPauseNs = 1'200'000'000'000;

}  // namespace

void LiveInstants::Add(const FrameInfo& frame) {
  if (std::holds_alternative<FirstSensorStamps>(times_)) {
    if (IsOfFirst(frame)) instants_ns_.push_back(frame.stamp_ns);
    return;
  }
  if (const auto* rate = std::get_if<Rate>(&times_)) {
    if (!of_rate_) of_rate_.emplace(*rate, frame.begin_ns, frame.begin_ns);
    // A stamp decades ahead must not fill the memory.
    next_ = std::max(next_, of_rate_->CountBefore(frame.begin_ns - kPauseNs));
    for (; (*of_rate_)[next_] <= frame.end_ns; ++next_) instants_ns_.push_back((*of_rate_)[next_]);
    return;
  }
  const auto& list = std::get<std::vector<TimeNs>>(times_);
  for (; next_ < list.size() && list[next_] <= frame.end_ns; ++next_) {
    instants_ns_.push_back(list[next_]);
  }
}

// A sensor without a frame yet counts as heard at the start of the stream.
bool LiveInstants::IsOfFirst(const FrameInfo& frame) {
  if (!begin_ns_) begin_ns_ = frame.stamp_ns;
  if (heard_ns_.size() <= frame.sensor) heard_ns_.resize(frame.sensor + 1, *begin_ns_);
  heard_ns_[frame.sensor] = frame.stamp_ns;
  const bool is_new = instants_ns_.empty() || *(instants_ns_.end() - 1) < frame.stamp_ns;
  return is_new &&
         std::all_of(heard_ns_.begin(), heard_ns_.begin() + frame.sensor,
                     [&](TimeNs heard_ns) { return frame.stamp_ns - heard_ns > silent_ns_; });
}

void LiveInstants::GetBetween(TimeNs after_ns, TimeNs until_ns, OutputInstants* instants) const {
  const auto first = std::upper_bound(instants_ns_.begin(), instants_ns_.end(), after_ns);
  instants->SetList(first, std::upper_bound(first, instants_ns_.end(), until_ns));
}

TimeInterval LiveInstants::Around(TimeNs instant_ns) const {
  const auto at = std::lower_bound(instants_ns_.begin(), instants_ns_.end(), instant_ns);
  const auto next = at + 1;
  const TimeNs before_ns = at != instants_ns_.begin() ? (*at - *(at - 1)) / 2 : 0;
  const TimeNs after_ns = next != instants_ns_.end() ? (*next - *at) / 2 : before_ns;
  return {*at - before_ns, *at + after_ns};
}

void LiveInstants::Forget(TimeNs oldest_ns) {
  while (instants_ns_.size() > 2 && instants_ns_[1] < oldest_ns) instants_ns_.pop_front();
}

}  // namespace unlidar
