#include "unlidar/robust/depth_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace unlidar {

DepthMap::DepthMap(const std::vector<Eigen::Vector3f>& points_m,
                   const std::vector<std::uint32_t>& bins, std::size_t num_bins, double cell_deg)
    : num_bins_(num_bins),
      columns_(static_cast<std::size_t>(std::ceil(360.0 / cell_deg))),
      rows_(static_cast<std::size_t>(std::ceil(180.0 / cell_deg))),
      column_rad_(2.0 * M_PI / static_cast<double>(columns_)),
      row_rad_(M_PI / static_cast<double>(rows_)) {
  constexpr double kQuantum_m = 0.05;
  std::vector<std::uint64_t> entries(points_m.size());
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const double quanta = std::min(65535.0, static_cast<double>(points_m[i].norm()) / kQuantum_m);
    entries[i] = (static_cast<std::uint64_t>(Index(points_m[i], bins[i])) << 16) |
                 static_cast<std::uint64_t>(quanta);
  }
  std::sort(entries.begin(), entries.end());
  median_m_.assign(columns_ * rows_ * num_bins_, std::numeric_limits<float>::infinity());
  for (std::size_t first = 0; first < entries.size();) {
    std::size_t last = first;
    while (last < entries.size() && entries[last] >> 16 == entries[first] >> 16) ++last;
    median_m_[entries[first] >> 16] =
        static_cast<float>(kQuantum_m * static_cast<double>(entries[(first + last) / 2] & 0xFFFF));
    first = last;
  }
}

const float* DepthMap::MediansM(const Eigen::Vector3f& point_m) const {
  return &median_m_[Index(point_m, 0)];
}

double DepthMap::HiddenShare(const Eigen::Vector3f& place_m, double radius_m,
                             double margin_m) const {
  const auto range_m = static_cast<double>(place_m.norm());
  const Eigen::Vector3d towards = place_m.cast<double>() / range_m;
  const double radius_rad = std::atan2(radius_m, range_m);
  const double least_cosine = std::cos(radius_rad);
  const double elevation_rad = std::asin(towards.z());
  double all = 0.0;
  double hidden = 0.0;
  // `first_bin`: index of the first bin of a cell.
  const auto add_cell = [&](std::size_t first_bin, double weight) {
    for (std::size_t i = first_bin; i < first_bin + num_bins_; ++i) {
      all += weight;
      if (static_cast<double>(median_m_[i]) < range_m - margin_m) hidden += weight;
    }
  };
  for (std::size_t row = 0; row < rows_; ++row) {
    const double at_rad = (static_cast<double>(row) + 0.5) * row_rad_ - M_PI / 2;
    if (std::abs(at_rad - elevation_rad) > radius_rad) continue;
    const double weight = std::cos(at_rad);  // cells are narrower towards the zenith
    const double sine = std::sin(at_rad);
    for (std::size_t column = 0; column < columns_; ++column) {
      const double azimuth_rad = (static_cast<double>(column) + 0.5) * column_rad_ - M_PI;
      const Eigen::Vector3d cell(weight * std::cos(azimuth_rad), weight * std::sin(azimuth_rad),
                                 sine);
      if (cell.dot(towards) < least_cosine) continue;
      add_cell((row * columns_ + column) * num_bins_, weight);
    }
  }
  if (all <= 0.0) add_cell(Index(place_m, 0), 1.0);  // narrower than a cell: its own has the word
  return hidden / all;
}

std::size_t DepthMap::Index(const Eigen::Vector3f& p, std::size_t bin) const {
  const double azimuth_rad = std::atan2(p.y(), p.x()) + M_PI;
  const double elevation_rad = std::atan2(p.z(), std::hypot(p.x(), p.y())) + M_PI / 2;
  const auto column = std::min(static_cast<std::size_t>(azimuth_rad / column_rad_), columns_ - 1);
  const auto row = std::min(static_cast<std::size_t>(elevation_rad / row_rad_), rows_ - 1);
  return (row * columns_ + column) * num_bins_ + bin;
}

}  // namespace unlidar
