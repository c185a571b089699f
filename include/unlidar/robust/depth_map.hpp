// How far one sees in each direction.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace unlidar {

// Median range of the returns per cell of directions, and per time bin.
class DepthMap {
 public:
  // `bins`: one per point, each below `num_bins`, which is at least 1.
  DepthMap(const std::vector<Eigen::Vector3f>& points_m, const std::vector<std::uint32_t>& bins,
           std::size_t num_bins, double cell_deg);

  // In the direction of a point, per bin (num_bins); infinite where nothing was seen.
  const float* MediansM(const Eigen::Vector3f& point_m) const;

  // Of the directions within `radius_m` of a place, as seen from the sensor, the share in which
  // something is nearer than the place by `margin_m`, over all bins.
  double HiddenShare(const Eigen::Vector3f& place_m, double radius_m, double margin_m) const;

 private:
  std::size_t Index(const Eigen::Vector3f& point_m, std::size_t bin) const;

  std::size_t num_bins_;
  std::size_t columns_;
  std::size_t rows_;
  double column_rad_;
  double row_rad_;
  std::vector<float> median_m_;  // (rows, columns, bins)
};

}  // namespace unlidar
