// Time bins in which something nearer hid a place.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/direction_cells.hpp"
#include "scene/recent_bins.hpp"

namespace unlidar {

// Median range in each direction for each of the last RecentBins::kWindow bins.
class Occlusion {
 public:
  Occlusion();

  // Adds the returns of a frame. Bins count up; those of earlier bins than the last one are
  // ignored.
  void Add(PointsView points_m, std::int64_t bin);

  // Returns the bins in which the median range in the direction of a place was shorter than its own
  // by more than the size of an occluder, by age before `newest`, the last bin added. That one is
  // not complete: it counts as hidden if the one before is.
  RecentBins HiddenBins(const Eigen::Vector3f& place_m, std::int64_t newest) const;

 private:
  void FinishBin();

  DirectionCells cells_;
  std::int64_t bin_ = -1;
  std::vector<std::uint32_t> returns_;  // of that bin: cell and quantised range
  // Quantised, by row, then by bin modulo the window: a place is compared with all bins of its
  // direction.
  std::vector<std::uint16_t> depths_;
  std::vector<std::uint32_t> rows_;  // (cells) of those that ever had returns
};

}  // namespace unlidar
