// What the recording says about every place at other times: structure, clutter or free space.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "unlidar/robust/range_grid.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

struct BackgroundConfig {
  RangeRadius place{0.35, 0.012};  // what counts as the same place
  double bin_s = 0.5;              // time resolution of occupancy
  double max_break_s = 1.5;        // a stay ends where a place was empty for longer
  double min_exposure = 0.15;      // a place must be known for this share of the recording
  double max_occupancy = 0.35;     // share of the other bins: more is structure
  double occluder_cell_deg = 2.0;  // directions in which something nearer hides a place
  double occluder_margin_m = 2.0;
};

// Occupancy of places over the whole recording.
class Background {
 public:
  Background(const Recording& recording, const BackgroundConfig& config);

  // The returns of structure and all others: indices into the recording, ascending.
  const std::vector<std::uint32_t>& structure() const { return structure_; }
  const std::vector<std::uint32_t>& unexplained() const { return unexplained_; }

  // Hits per m^3 and frame at the place of return `i` outside its stay; 0 for structure, and where
  // at most one other bin has any. A place that is seldom hit in the midst of much that is hit
  // often, as in dense rain near the sensor, is no open air.
  double PlaceRate(std::uint32_t i) const { return static_cast<double>(place_rate_[i]); }

  // Returns per m^3 and frame at a place, as seen in the bins that do not touch [from, to].
  // Negative where there are too few such bins to know.
  double RateOutside(const Eigen::Vector3f& place_m, TimeNs from_ns, TimeNs to_ns) const;

  // Time bins. A pause between frames takes no more of them than it needs to end every stay.
  std::size_t num_bins() const { return is_watched_.size(); }
  std::size_t BinOf(TimeNs time_ns) const;

  // (sensors, bins): how many frames of a sensor begin in a bin.
  const std::vector<std::vector<double>>& frames_in_bin() const { return frames_in_bin_; }

 private:
  void MakeBins(const Recording& recording);
  void Classify(const Recording& recording);

  BackgroundConfig config_;
  TimeNs begin_ns_ = 0;
  TimeNs bin_ns_ = 1;
  std::map<TimeNs, std::size_t> watched_bins_;  // by begin / bin_ns_: those with frames
  std::vector<char> is_watched_;                // (num_bins)
  std::vector<std::vector<double>> frames_in_bin_;
  RangeGrid grid_;
  std::vector<float> place_rate_;  // (N)
  std::vector<std::uint32_t> structure_;
  std::vector<std::uint32_t> unexplained_;
};

}  // namespace unlidar
