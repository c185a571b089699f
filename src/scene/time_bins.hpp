// Time line of a station in bins.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/range_grid.hpp"

namespace unlidar {

// Length of a time bin.
constexpr TimeNs kBinNs = 500'000'000;
constexpr double kBinS = static_cast<double>(kBinNs) * kSecondsPerNs;
// Longer pauses between frames are shortened to this many bins, which end every dwell.
constexpr std::int64_t kMaxPauseBins = 5;

// Bins of the frames of a recording, numbered in order of time.
class TimeBins {
 public:
  // `frames`: in any order. `num_sensors`: of the recording.
  TimeBins(const std::vector<FrameInfo>& frames, std::size_t num_sensors);

  std::uint32_t num_bins() const { return numbers_.empty() ? 0 : numbers_.back() + 1; }

  // Returns the bin of a time; the last one for later times.
  std::uint32_t BinOf(TimeNs time_ns) const;

  // Returns the bins at most `margin` before or after this one.
  BinRange BinsAround(std::uint32_t bin, std::uint32_t margin) const {
    return {bin - std::min(bin, margin), std::min(bin + margin + 1, num_bins())};
  }

  // Returns the bins that overlap [from_ns, to_ns].
  BinRange BinsTouching(TimeNs from_ns, TimeNs to_ns) const;

  // Number of frames of a sensor whose middle is in these bins.
  std::uint32_t NumFrames(std::size_t sensor, BinRange bins) const {
    return frames_before_[sensor][bins.last] - frames_before_[sensor][bins.first];
  }

  // Number of frames, of any sensor, whose middle is outside these bins.
  std::uint32_t NumFramesOutside(BinRange inside) const;

 private:
  // Time in bin lengths since the first frame.
  using Tick = std::uint64_t;

  Tick TickOf(TimeNs time_ns) const;
  std::uint32_t NumberOf(Tick tick) const;

  TimeNs begin_ns_ = 0;
  std::vector<Tick> ticks_;                                // that hold the middle of a frame,
  std::vector<std::uint32_t> numbers_;                     // and their bins, ascending
  std::vector<std::vector<std::uint32_t>> frames_before_;  // (sensors, num_bins + 1)
};

}  // namespace unlidar
