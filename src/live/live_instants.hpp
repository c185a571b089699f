// The output times of a stream, which grow with its frames.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "trajectory/sampling.hpp"

namespace unlidar {

// Same as ResolveOutputTimes() of a recording, up to the newest frame; old times are forgotten.
// The first sensor is the first one that is not silent, so that rows continue if one is unplugged.
class LiveInstants {
 public:
  LiveInstants(OutputTimes times, TimeNs silent_ns)
      : times_(std::move(times)), silent_ns_(silent_ns) {}

  // Adds the output times up to the end of a frame, or for FirstSensorStamps its stamp, if it is of
  // the first sensor. Frames come in order of stamps.
  void Add(const FrameInfo& frame) {
    if (std::holds_alternative<FirstSensorStamps>(times_)) {
      if (IsOfFirst(frame)) instants_ns_.push_back(frame.stamp_ns);
      return;
    }
    if (const auto* rate = std::get_if<Rate>(&times_)) {
      if (!of_rate_) of_rate_.emplace(*rate, frame.begin_ns, frame.begin_ns);
      // A stamp decades ahead must not fill the memory.
      next_ = std::max(next_, of_rate_->CountBefore(frame.begin_ns - kPauseNs));
      for (; (*of_rate_)[next_] <= frame.end_ns; ++next_) {
        instants_ns_.push_back((*of_rate_)[next_]);
      }
      return;
    }
    const auto& list = std::get<std::vector<TimeNs>>(times_);
    for (; next_ < list.size() && list[next_] <= frame.end_ns; ++next_) {
      instants_ns_.push_back(list[next_]);
    }
  }

  // Sets the output times after `after_ns`, up to `until_ns`.
  void GetBetween(TimeNs after_ns, TimeNs until_ns, OutputInstants* instants) const {
    const auto first = std::upper_bound(instants_ns_.begin(), instants_ns_.end(), after_ns);
    instants->SetList(first, std::upper_bound(first, instants_ns_.end(), until_ns));
  }

  // Returns the stamps [begin_ns, end_ns) whose frames support the row at an output time: from
  // halfway to the previous one to halfway to the next one. The first interval begins at its output
  // time; the last one is symmetric.
  TimeInterval Around(TimeNs instant_ns) const {
    const auto at = std::lower_bound(instants_ns_.begin(), instants_ns_.end(), instant_ns);
    const auto next = at + 1;
    const TimeNs before_ns = at != instants_ns_.begin() ? (*at - *(at - 1)) / 2 : 0;
    const TimeNs after_ns = next != instants_ns_.end() ? (*next - *at) / 2 : before_ns;
    return {*at - before_ns, *at + after_ns};
  }

  // Forgets the output times before `oldest_ns`, except the last of them.
  void Forget(TimeNs oldest_ns) {
    while (instants_ns_.size() > 2 && instants_ns_[1] < oldest_ns) instants_ns_.pop_front();
  }

 private:
  // No track continues through a longer pause: twice the largest robust.tracker.max_gap_s.
  static constexpr TimeNs kPauseNs = 1'200'000'000'000;

  // A sensor without a frame yet counts as heard at the start of the stream.
  bool IsOfFirst(const FrameInfo& frame) {
    if (!begin_ns_) begin_ns_ = frame.stamp_ns;
    if (heard_ns_.size() <= frame.sensor) heard_ns_.resize(frame.sensor + 1, *begin_ns_);
    heard_ns_[frame.sensor] = frame.stamp_ns;
    const bool is_new = instants_ns_.empty() || *(instants_ns_.end() - 1) < frame.stamp_ns;
    return is_new &&
           std::all_of(heard_ns_.begin(), heard_ns_.begin() + frame.sensor,
                       [&](TimeNs heard_ns) { return frame.stamp_ns - heard_ns > silent_ns_; });
  }

  OutputTimes times_;
  TimeNs silent_ns_;
  std::optional<TimeNs> begin_ns_;  // of the stream
  std::vector<TimeNs> heard_ns_;    // (sensors) last stamps
  Queue<TimeNs> instants_ns_;
  std::optional<OutputInstants> of_rate_;  // without an end
  std::size_t next_ = 0;                   // index into a rate or a list
};

}  // namespace unlidar
