// Time line of a station in bins.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "base/algorithms.hpp"
#include "base/recording.hpp"
#include "scene/range_grid.hpp"

namespace unlidar {

// Length of a time bin.
constexpr TimeNs kBinNs = 500'000'000;
constexpr double kBinS = static_cast<double>(kBinNs) * kSecondsPerNs;
// Longer pauses between frames are shortened to this many bins, no more than the default break of a
// dwell (robust.background.max_dwell_gap_s): what was there before and is there after has stayed.
constexpr std::int64_t kMaxPauseBins = 3;

// Bins of the frames of a recording, numbered in order of time.
class TimeBins {
 public:
  // `frames`: in any order. `num_sensors`: of the recording.
  TimeBins(const std::vector<FrameInfo>& frames, std::size_t num_sensors) {
    begin_ns_ = std::numeric_limits<TimeNs>::max();
    for (const FrameInfo& frame : frames) begin_ns_ = std::min(begin_ns_, frame.begin_ns);
    for (const FrameInfo& frame : frames) ticks_.push_back(TickOf(frame.middle_ns()));
    ticks_ = SortedUnique(std::move(ticks_));
    Tick before = 0;
    for (const Tick tick : ticks_) {
      const auto passed = static_cast<std::uint32_t>(std::min<Tick>(tick - before, kMaxPauseBins));
      numbers_.push_back((numbers_.empty() ? 0 : numbers_.back()) + passed);
      before = tick;
    }
    frames_before_.assign(num_sensors, std::vector<std::uint32_t>(num_bins() + 1, 0));
    for (const FrameInfo& frame : frames) {
      ++frames_before_[frame.sensor][BinOf(frame.middle_ns()) + 1];
    }
    for (auto& before_bin : frames_before_) {
      std::partial_sum(before_bin.begin(), before_bin.end(), before_bin.begin());
    }
  }

  std::uint32_t num_bins() const { return numbers_.empty() ? 0 : numbers_.back() + 1; }

  // Returns the bin of a time; the last one for later times.
  std::uint32_t BinOf(TimeNs time_ns) const {
    return std::min(NumberOf(TickOf(time_ns)), std::max(num_bins(), 1U) - 1);
  }

  // Returns the bins at most `margin` before or after this one.
  BinRange BinsAround(std::uint32_t bin, std::uint32_t margin) const {
    return {bin - std::min(bin, margin), std::min(bin + margin + 1, num_bins())};
  }

  // Returns the bins that overlap [from_ns, to_ns].
  BinRange BinsTouching(TimeNs from_ns, TimeNs to_ns) const {
    return {NumberOf(TickOf(from_ns)), std::min(NumberOf(TickOf(to_ns)) + 1, num_bins())};
  }

  // Number of frames of a sensor whose middle is in these bins.
  std::uint32_t NumFrames(std::size_t sensor, BinRange bins) const {
    return frames_before_[sensor][bins.last] - frames_before_[sensor][bins.first];
  }

  // Number of frames, of any sensor, whose middle is outside these bins.
  std::uint32_t NumFramesOutside(BinRange inside) const {
    std::uint32_t frames = 0;
    for (std::size_t sensor = 0; sensor < frames_before_.size(); ++sensor) {
      frames += NumFrames(sensor, {0, num_bins()}) - NumFrames(sensor, inside);
    }
    return frames;
  }

 private:
  // Time in bin lengths since the first frame.
  using Tick = std::uint64_t;

  Tick TickOf(TimeNs time_ns) const {
    if (time_ns <= begin_ns_) return 0;
    // Unsigned: the difference of two times may exceed the range of TimeNs.
    return (static_cast<std::uint64_t>(time_ns) - static_cast<std::uint64_t>(begin_ns_)) /
           static_cast<std::uint64_t>(kBinNs);
  }

  // Returns the number of a tick; num_bins() after the last one. A pause counts on from the frame
  // before it.
  std::uint32_t NumberOf(Tick tick) const {
    const auto next = std::lower_bound(ticks_.begin(), ticks_.end(), tick);
    if (next == ticks_.end()) return num_bins();
    const auto i = static_cast<std::size_t>(next - ticks_.begin());
    const Tick passed = tick - (i == 0 ? 0 : ticks_[i - 1]);
    const Tick number = (i == 0 ? 0 : numbers_[i - 1]) + passed;
    return static_cast<std::uint32_t>(std::min<Tick>(number, numbers_[i]));
  }

  TimeNs begin_ns_ = 0;
  std::vector<Tick> ticks_;                                // that hold the middle of a frame,
  std::vector<std::uint32_t> numbers_;                     // and their bins, ascending
  std::vector<std::vector<std::uint32_t>> frames_before_;  // (sensors, num_bins + 1)
};

}  // namespace unlidar
