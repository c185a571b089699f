#include "scene/depth_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "base/angles.hpp"

namespace unlidar {

DepthMap::DepthMap(double cell_deg)
    : columns_(static_cast<std::size_t>(std::ceil(360.0 / cell_deg))),
      rows_(static_cast<std::size_t>(std::ceil(180.0 / cell_deg))),
      column_rad_(2.0 * M_PI / static_cast<double>(columns_)),
      row_rad_(M_PI / static_cast<double>(rows_)),
      medians_m_(columns_ * rows_, std::numeric_limits<float>::infinity()) {
  for (std::size_t row = 0; row < rows_; ++row) {
    const double at_rad = (static_cast<double>(row) + 0.5) * row_rad_ - M_PI / 2;
    elevations_.push_back({at_rad, std::cos(at_rad), std::sin(at_rad)});
  }
  for (std::size_t column = 0; column < columns_; ++column) {
    const double at_rad = (static_cast<double>(column) + 0.5) * column_rad_ - M_PI;
    azimuths_.push_back({at_rad, std::cos(at_rad), std::sin(at_rad)});
  }
}

void DepthMap::Fill(const PointsView& points_m, Workspace* workspace) {
  auto& [cells, ends, ranges_m] = *workspace;
  cells.resize(points_m.size());
  ends.assign(medians_m_.size() + 1, 0);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    cells[i] = static_cast<std::uint32_t>(CellOf(points_m[i]));
    ++ends[cells[i] + 1];
  }
  std::partial_sum(ends.begin(), ends.end(), ends.begin());
  ranges_m.resize(points_m.size());
  for (std::size_t i = 0; i < cells.size(); ++i) ranges_m[ends[cells[i]]++] = points_m[i].norm();
  auto begin = ranges_m.begin();
  for (std::size_t cell = 0; cell < medians_m_.size(); ++cell) {
    const auto end = ranges_m.begin() + static_cast<std::ptrdiff_t>(ends[cell]);
    const auto middle = begin + (end - begin) / 2;
    std::nth_element(begin, middle, end);
    medians_m_[cell] = begin == end ? std::numeric_limits<float>::infinity() : *middle;
    begin = end;
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
  for (std::size_t row = 0; row < rows_; ++row) {
    const Angle& elevation = elevations_[row];
    if (std::abs(elevation.rad - elevation_rad) > radius_rad) continue;
    const double weight = elevation.cosine;  // cells are narrower towards the zenith
    const bool is_in_view = elevation.rad > view.lowest_rad && elevation.rad < view.highest_rad;
    for (std::size_t column = 0; column < columns_; ++column) {
      const Angle& azimuth = azimuths_[column];
      const Eigen::Vector3d cell(weight * azimuth.cosine, weight * azimuth.sine, elevation.sine);
      if (cell.dot(towards) < min_cosine) continue;
      all += weight;
      if (!is_in_view || is_hidden(row * columns_ + column)) hidden += weight;
    }
  }
  // A neighbourhood narrower than a cell: use the cell of the place.
  if (all == 0.0) return is_hidden(CellOf(place_m)) ? 1.0 : 0.0;
  return hidden / all;
}

// Exact angles are computed only near the edges of cells.
std::size_t DepthMap::CellOf(const Eigen::Vector3f& p) const {
  const auto number_of = [](double approximate_rad, double cell_rad, const auto& exact_rad) {
    const double from = (approximate_rad - kApproximateAtan2ErrorRad) / cell_rad;
    const double to = (approximate_rad + kApproximateAtan2ErrorRad) / cell_rad;
    const double number = from > 0.0 ? static_cast<double>(static_cast<std::size_t>(from)) : -1.0;
    return static_cast<std::size_t>(number >= 0.0 && to < number + 1.0 ? number
                                                                       : exact_rad() / cell_rad);
  };
  const Eigen::Vector3d q = p.cast<double>();
  const std::size_t column = number_of(ApproximateAtan2(q.y(), q.x()) + M_PI, column_rad_,
                                       [&] { return AzimuthRad(p) + M_PI; });
  const std::size_t row = number_of(ApproximateAtan2(q.z(), q.head<2>().norm()) + M_PI / 2,
                                    row_rad_, [&] { return ElevationRad(p) + M_PI / 2; });
  return std::min(row, rows_ - 1) * columns_ + std::min(column, columns_ - 1);
}

}  // namespace unlidar
