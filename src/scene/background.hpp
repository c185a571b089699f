// Classifies every place by its occupancy at other times: structure, clutter or free space.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/recording.hpp"
#include "scene/range_grid.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Occupancy of places over the whole recording.
class Background {
 public:
  Background(const Recording& recording, const BackgroundConfig& config);

  // Returns of structure, and all others: indices into the recording, ascending.
  const std::vector<std::uint32_t>& structure() const { return structure_; }
  const std::vector<std::uint32_t>& unexplained() const { return unexplained_; }

  // Returns the hits per m^3 and frame at the place of return `i` outside its dwell; 0 for
  // structure, and where at most one other bin has hits. In dense rain near the sensor most places
  // are structure; those seldom hit among them are not open air.
  double PlaceRate(std::uint32_t i) const;

  // Returns the rate of returns per m^3 and frame at a place in the bins that do not touch
  // [from_ns, to_ns], with half a return where there was none; negative if these bins are less than
  // the share BackgroundConfig::min_exposure of all.
  double RateOutside(const Eigen::Vector3f& place_m, TimeNs from_ns, TimeNs to_ns) const;

  // Number of time bins; they are numbered in order of time. Pauses between frames have none.
  std::uint32_t num_bins() const { return static_cast<std::uint32_t>(ticks_.size()); }

  // Returns the bin of a time within a frame.
  std::uint32_t BinOf(TimeNs time_ns) const;

  // Returns the bins that begin at most `margin` bin lengths before or after this one.
  BinRange BinsAround(std::uint32_t bin, std::uint32_t margin) const;

  // Returns the bins that overlap [from_ns, to_ns].
  BinRange BinsTouching(TimeNs from_ns, TimeNs to_ns) const {
    return {FirstBinFrom(TickOf(from_ns)), FirstBinFrom(TickOf(to_ns) + 1)};
  }

  // Number of frames, of any sensor, that begin outside these bins.
  std::uint32_t NumFramesOutside(BinRange inside) const;

  // Number of frames of a sensor that begin in these bins.
  std::uint32_t NumFrames(std::size_t sensor, BinRange bins) const {
    return frames_before_[sensor][bins.last] - frames_before_[sensor][bins.first];
  }

 private:
  // Time in bin lengths since the recording began.
  using Tick = std::uint64_t;

  void MakeBins(const Recording& recording);
  // Returns the place of each return.
  std::vector<std::uint32_t> AddToGrid(const Recording& recording,
                                       const std::vector<std::uint32_t>& bins);
  void Classify(const Recording& recording);
  Tick TickOf(TimeNs time_ns) const;
  // Returns the first bin that begins at the tick or later; num_bins() if there is none.
  std::uint32_t FirstBinFrom(Tick tick) const;

  BackgroundConfig config_;
  TimeNs begin_ns_ = 0;
  TimeNs bin_ns_ = 1;
  std::vector<Tick> ticks_;                                // (num_bins) begin of each, ascending
  std::vector<std::vector<std::uint32_t>> frames_before_;  // (sensors, num_bins + 1)
  RangeGrid grid_;
  std::vector<std::uint32_t> structure_;
  std::vector<std::uint32_t> unexplained_;
  std::vector<std::pair<std::uint32_t, float>> place_rates_;  // ascending by return, nonzero only
};

}  // namespace unlidar
