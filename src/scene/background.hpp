// What the recording says about every place at other times: structure, clutter or free space.
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

  // The returns of structure and all others: indices into the recording, ascending.
  const std::vector<std::uint32_t>& structure() const { return structure_; }
  const std::vector<std::uint32_t>& unexplained() const { return unexplained_; }

  // Hits per m^3 and frame at the place of return `i` outside its dwell; 0 for structure, and where
  // at most one other bin has any. A place that is seldom hit in the midst of much that is hit
  // often, as in dense rain near the sensor, is no open air.
  double PlaceRate(std::uint32_t i) const;

  // Returns per m^3 and frame at a place, as seen in the bins that do not touch [from, to]: those
  // of half a return where there was none. Negative where there are too few such bins to know.
  double RateOutside(const Eigen::Vector3f& place_m, TimeNs from_ns, TimeNs to_ns) const;

  // The time bins in which there are frames, numbered in order of time: pauses have none.
  std::uint32_t num_bins() const { return static_cast<std::uint32_t>(ticks_.size()); }

  // The bin of a time within a frame.
  std::uint32_t BinOf(TimeNs time_ns) const;

  // The bins that begin at most `margin` times the length of a bin before or after this one.
  BinRange BinsAround(std::uint32_t bin, std::uint32_t margin) const;

  // The bins of which some part lies in [from, to].
  BinRange BinsTouching(TimeNs from_ns, TimeNs to_ns) const {
    return {FirstBinFrom(TickOf(from_ns)), FirstBinFrom(TickOf(to_ns) + 1)};
  }

  // How many frames, of any sensor, begin in no bin of these.
  std::uint32_t NumFramesOutside(BinRange inside) const;

  // How many frames of a sensor begin in some bins.
  std::uint32_t NumFrames(std::size_t sensor, BinRange bins) const {
    return frames_before_[sensor][bins.last] - frames_before_[sensor][bins.first];
  }

 private:
  // Time in lengths of a bin since the recording began.
  using Tick = std::uint64_t;

  void MakeBins(const Recording& recording);
  // Gives the place of each return.
  std::vector<std::uint32_t> AddToGrid(const Recording& recording,
                                       const std::vector<std::uint32_t>& bins);
  void Classify(const Recording& recording);
  Tick TickOf(TimeNs time_ns) const;
  // The first bin that does not begin before a tick; num_bins() if there is none.
  std::uint32_t FirstBinFrom(Tick tick) const;

  BackgroundConfig config_;
  TimeNs begin_ns_ = 0;
  TimeNs bin_ns_ = 1;
  std::vector<Tick> ticks_;                                // (num_bins) begin of each, ascending
  std::vector<std::vector<std::uint32_t>> frames_before_;  // (sensors, num_bins + 1)
  RangeGrid grid_;
  std::vector<std::uint32_t> structure_;
  std::vector<std::uint32_t> unexplained_;
  std::vector<std::pair<std::uint32_t, float>> place_rates_;  // of returns that have one
};

}  // namespace unlidar
