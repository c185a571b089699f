// Median range of the returns in each direction.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/field_of_view.hpp"

namespace unlidar {

// Median range of the returns per direction cell and time bin. Sparse: only pairs of cell and bin
// with returns are stored.
class DepthMap {
 public:
  struct Depth {
    std::uint32_t bin;
    float median_m;
  };

  // Depths of one cell, ascending by bin.
  class Depths {
   public:
    Depths(const Depth* begin, const Depth* end) : begin_(begin), end_(end) {}
    const Depth* begin() const { return begin_; }
    const Depth* end() const { return end_; }

   private:
    const Depth* begin_;
    const Depth* end_;
  };

  // Buffers of Fill(), kept for reuse.
  struct Workspace {
    std::vector<std::uint32_t> cells;    // (points)
    std::vector<std::size_t> next;       // by cell
    std::vector<std::uint64_t> entries;  // (points) by cell
  };

  // An empty map of one time bin.
  explicit DepthMap(double cell_deg);

  // `bins`: one per point, each below `num_bins` >= 1; or empty if all are 0.
  DepthMap(const PointsView& points_m, const std::vector<std::uint32_t>& bins, std::size_t num_bins,
           double cell_deg);

  // Replaces the contents, reusing memory. Arguments as for the constructor.
  void Fill(const PointsView& points_m, const std::vector<std::uint32_t>& bins,
            std::size_t num_bins, Workspace* workspace);

  // Returns the depths in the direction of a point.
  Depths DepthsAt(const Eigen::Vector3f& point_m) const { return DepthsOf(CellOf(point_m)); }

  // Returns the share, over all bins, of the directions within `radius_m` of a place, as seen from
  // the sensor, that are out of view or in which something is nearer than the place by `margin_m`.
  double HiddenShare(const Eigen::Vector3f& place_m, double radius_m, double margin_m,
                     const ElevationRange& view) const;

 private:
  struct Angle {
    double rad;
    double cosine;
    double sine;
  };

  std::size_t CellOf(const Eigen::Vector3f& point_m) const;
  Depths DepthsOf(std::size_t cell) const {
    return {depths_.data() + first_[cell], depths_.data() + first_[cell + 1]};
  }

  std::size_t num_bins_;
  std::size_t columns_;
  std::size_t rows_;
  double column_rad_;
  double row_rad_;
  std::vector<Angle> elevations_;   // (rows) of the cell centres
  std::vector<Angle> azimuths_;     // (columns)
  std::vector<std::size_t> first_;  // (rows x columns + 1) begin of each cell in `depths_`
  std::vector<Depth> depths_;       // by cell, then by bin
};

}  // namespace unlidar
