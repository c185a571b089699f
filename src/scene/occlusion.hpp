// Time bins in which something nearer hid a place.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/angles.hpp"
#include "base/recording.hpp"
#include "scene/field_of_view.hpp"
#include "scene/recent_bins.hpp"

namespace unlidar {

// Median range in each direction for each of the last RecentBins::kWindow bins, as seen from where
// the station was in that bin. Places and returns are relative to its first viewpoint.
class Occlusion {
 public:
  Occlusion();

  // Adds the returns of a frame. Bins count up; those of earlier bins than the last one are
  // ignored.
  void Add(PointsView points_m, std::int64_t bin, const CarrierPose& carrier);

  // Bins by age.
  struct Hidden {
    RecentBins behind;  // something nearer
    RecentBins unseen;  // out of view, or too far away to return as much
  };

  // Returns the bins in which the median range in the direction of a place was shorter than its own
  // by more than the size of an occluder and, if the carrier moves, those in which the place was
  // out of view, or so much farther from the sensor than in `bin` that a thing there might have
  // returned nothing. Ages count from `newest`, the last bin added. That one is not complete: it
  // counts as the one before.
  Hidden HiddenBins(const Eigen::Vector3f& place_m, std::int64_t bin, std::int64_t newest) const;

  // Returns where the station was in the last bin added, relative to its first viewpoint.
  const Eigen::Vector3f& ViewpointM() const;

  const FieldOfView& field_of_view() const { return field_of_view_; }

 private:
  void FinishBin();
  void Insert(int slot, std::int64_t newest, RecentBins* bins) const;

  std::int64_t bin_ = -1;
  std::vector<std::uint32_t> cell_of_;  // (returns of that bin)
  std::vector<std::uint16_t> quanta_;   // (the same) quantised ranges
  std::vector<std::uint16_t> sorted_;   // buffer of FinishBin(): these, by cell
  std::vector<std::uint32_t> begins_;   // (cells + 1) in sorted_
  // Quantised, by row, then by bin modulo the window: a place is compared with all bins of its
  // direction.
  std::vector<std::uint16_t> depths_;
  std::vector<std::uint32_t> rows_;    // (cells) of those that ever had returns
  std::vector<CarrierPose> carriers_;  // at the begin of each bin, by bin modulo the window
  FieldOfView field_of_view_;
};

}  // namespace unlidar
