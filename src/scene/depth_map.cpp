#include "scene/depth_map.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/angles.hpp"

namespace unlidar {

DepthMap::DepthMap(double cell_deg)
    : num_bins_(1),
      columns_(static_cast<std::size_t>(std::ceil(360.0 / cell_deg))),
      rows_(static_cast<std::size_t>(std::ceil(180.0 / cell_deg))),
      column_rad_(2.0 * M_PI / static_cast<double>(columns_)),
      row_rad_(M_PI / static_cast<double>(rows_)),
      first_(columns_ * rows_ + 1, 0) {
  for (std::size_t row = 0; row < rows_; ++row) {
    const double at_rad = (static_cast<double>(row) + 0.5) * row_rad_ - M_PI / 2;
    elevations_.push_back({at_rad, std::cos(at_rad), std::sin(at_rad)});
  }
  for (std::size_t column = 0; column < columns_; ++column) {
    const double at_rad = (static_cast<double>(column) + 0.5) * column_rad_ - M_PI;
    azimuths_.push_back({at_rad, std::cos(at_rad), std::sin(at_rad)});
  }
}

DepthMap::DepthMap(const PointsView& points_m, const std::vector<std::uint32_t>& bins,
                   std::size_t num_bins, double cell_deg)
    : DepthMap(cell_deg) {
  Workspace workspace;
  Fill(points_m, bins, num_bins, &workspace);
}

void DepthMap::Fill(const PointsView& points_m, const std::vector<std::uint32_t>& bins,
                    std::size_t num_bins, Workspace* workspace) {
  // Points grouped by cell in input order, which is mostly the order of the bins.
  constexpr double kQuantum_m = 0.05;
  constexpr std::uint64_t kMaxQuanta = 0xFFFF;
  auto& [cells, next, entries] = *workspace;
  num_bins_ = num_bins;
  cells.resize(points_m.size());
  next.assign(columns_ * rows_ + 1, 0);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    cells[i] = static_cast<std::uint32_t>(CellOf(points_m[i]));
    ++next[cells[i] + 1];
  }
  std::partial_sum(next.begin(), next.end(), next.begin());
  entries.resize(points_m.size());  // bin << 16 | range
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const double quanta = std::min(static_cast<double>(kMaxQuanta),
                                   static_cast<double>(points_m[i].norm()) / kQuantum_m);
    const std::uint64_t bin = bins.empty() ? 0 : bins[i];
    entries[next[cells[i]]++] = bin << 16U | static_cast<std::uint64_t>(quanta);
  }
  const auto bin_of = [](std::uint64_t entry) { return entry >> 16U; };
  depths_.clear();
  first_.clear();
  auto begin = entries.begin();
  for (std::size_t cell = 0; cell < columns_ * rows_; ++cell) {
    first_.push_back(depths_.size());
    const auto end = entries.begin() + static_cast<std::ptrdiff_t>(next[cell]);
    const auto is_earlier = [&](std::uint64_t a, std::uint64_t b) { return bin_of(a) < bin_of(b); };
    if (!std::is_sorted(begin, end, is_earlier)) std::sort(begin, end);
    while (begin != end) {
      const auto last = std::find_if(
          begin, end, [&](std::uint64_t entry) { return bin_of(entry) != bin_of(*begin); });
      const auto middle = begin + (last - begin) / 2;
      std::nth_element(begin, middle, last);
      depths_.push_back(
          {static_cast<std::uint32_t>(bin_of(*middle)),
           static_cast<float>(kQuantum_m * static_cast<double>(*middle & kMaxQuanta))});
      begin = last;
    }
  }
  first_.push_back(depths_.size());
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
  const auto num_bins = static_cast<double>(num_bins_);
  const auto hidden_bins = [&](std::size_t cell) {
    const Depths depths = DepthsOf(cell);
    return static_cast<double>(std::count_if(depths.begin(), depths.end(), [&](const Depth& depth) {
      return static_cast<double>(depth.median_m) < range_m - margin_m;
    }));
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
      all += weight * num_bins;
      hidden += weight * (is_in_view ? hidden_bins(row * columns_ + column) : num_bins);
    }
  }
  // A neighbourhood narrower than a cell: use the cell of the place.
  return all > 0.0 ? hidden / all : hidden_bins(CellOf(place_m)) / num_bins;
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
