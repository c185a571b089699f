#include "scene/depth_map.hpp"

#include <cmath>
#include <limits>

#include "base/algorithms.hpp"

namespace unlidar {

DepthMap::DepthMap(double cell_deg)
    : cells_(cell_deg), medians_m_(cells_.size(), std::numeric_limits<float>::infinity()) {
  const auto angle_of = [](double rad) { return Angle{rad, std::cos(rad), std::sin(rad)}; };
  for (std::size_t row = 0; row < cells_.rows(); ++row) {
    elevations_.push_back(angle_of(cells_.RowRad(row)));
  }
  for (std::size_t column = 0; column < cells_.columns(); ++column) {
    azimuths_.push_back(angle_of(cells_.ColumnRad(column)));
  }
}

void DepthMap::Fill(const PointsView& points_m) {
  cell_of_.resize(points_m.size());
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    cell_of_[i] = static_cast<std::uint32_t>(cells_.CellOf(points_m[i]));
  }
  ranges_m_.resize(points_m.size());
  SortByGroup(cell_of_, medians_m_.size(), &begins_,
              [&](std::size_t i, std::uint32_t at) { ranges_m_[at] = points_m[i].norm(); });
  for (std::size_t cell = 0; cell < medians_m_.size(); ++cell) {
    float* const begin = ranges_m_.data() + begins_[cell];
    float* const end = ranges_m_.data() + begins_[cell + 1];
    medians_m_[cell] = begin == end ? std::numeric_limits<float>::infinity()
                                    : NthSmallest(begin, end, (end - begin) / 2);
  }
}

double DepthMap::HiddenShare(const Eigen::Vector3f& place_m, double radius_m, double margin_m,
                             const ElevationRange& view) const {
  const auto range_m = static_cast<double>(place_m.norm());
  const Eigen::Vector3d towards = place_m.cast<double>() / range_m;
  const double radius_rad = std::atan2(radius_m, range_m);
  const double min_cosine = std::cos(radius_rad);
  const double elevation_rad = std::asin(towards.z());
  double all = 0.0;
  double hidden = 0.0;
  const auto is_hidden = [&](std::size_t cell) {
    return static_cast<double>(medians_m_[cell]) < range_m - margin_m;
  };
  for (std::size_t row = 0; row < cells_.rows(); ++row) {
    const Angle& elevation = elevations_[row];
    if (std::abs(elevation.rad - elevation_rad) > radius_rad) continue;
    const double weight = elevation.cosine;  // cells are narrower towards the zenith
    for (std::size_t column = 0; column < cells_.columns(); ++column) {
      const Angle& azimuth = azimuths_[column];
      const Eigen::Vector3d cell(weight * azimuth.cosine, weight * azimuth.sine, elevation.sine);
      if (cell.dot(towards) < min_cosine) continue;
      all += weight;
      if (!view.Contains(cell, elevation.rad) || is_hidden(row * cells_.columns() + column)) {
        hidden += weight;
      }
    }
  }
  // A neighbourhood narrower than a cell: use the cell of the place.
  if (all == 0.0) return is_hidden(cells_.CellOf(place_m)) ? 1.0 : 0.0;
  return hidden / all;
}

}  // namespace unlidar
