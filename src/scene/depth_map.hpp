// Median range of the returns in each direction.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/angles.hpp"
#include "base/recording.hpp"
#include "scene/field_of_view.hpp"

namespace unlidar {

// Median range of the returns per direction cell.
class DepthMap {
 public:
  // An empty map.
  explicit DepthMap(double cell_deg);

  // Replaces the contents, reusing memory.
  void Fill(const PointsView& points_m);

  // Median range in the direction of a place, as seen from the sensor; infinity without returns.
  float MedianM(const Eigen::Vector3f& place_m) const { return medians_m_[cells_.CellOf(place_m)]; }

  // Returns the share of the directions within `radius_m` of a place, as seen from the sensor, that
  // are out of view or in which something is nearer than the place by `margin_m`.
  double HiddenShare(const Eigen::Vector3f& place_m, double radius_m, double margin_m,
                     const ElevationRange& view) const;

 private:
  struct Angle {
    double rad;
    double cosine;
    double sine;
  };

  DirectionCells cells_;
  std::vector<Angle> elevations_;  // (rows) of the cell centres
  std::vector<Angle> azimuths_;    // (columns)
  std::vector<float> medians_m_;   // (rows x columns) infinity without returns
  // Buffers of Fill(), kept for reuse.
  std::vector<std::uint32_t> cell_of_;  // (points)
  std::vector<std::uint32_t> begins_;   // (cells + 1) in ranges_m_
  std::vector<float> ranges_m_;         // (points) by cell
};

}  // namespace unlidar
