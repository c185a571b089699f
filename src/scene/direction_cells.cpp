#include "scene/direction_cells.hpp"

#include <algorithm>
#include <cmath>

#include "base/angles.hpp"

namespace unlidar {

DirectionCells::DirectionCells(double cell_deg)
    : columns_(static_cast<std::size_t>(std::ceil(360.0 / cell_deg))),
      rows_(static_cast<std::size_t>(std::ceil(180.0 / cell_deg))),
      column_rad_(2.0 * M_PI / static_cast<double>(columns_)),
      row_rad_(M_PI / static_cast<double>(rows_)) {}

double DirectionCells::ElevationRad(std::size_t row) const {
  return (static_cast<double>(row) + 0.5) * row_rad_ - M_PI / 2;
}

double DirectionCells::AzimuthRad(std::size_t column) const {
  return (static_cast<double>(column) + 0.5) * column_rad_ - M_PI;
}

// Exact angles are computed only near the edges of cells.
std::size_t DirectionCells::CellOf(const Eigen::Vector3f& p) const {
  const auto number_of = [](double approximate_rad, double cell_rad, const auto& exact_rad) {
    const double from = (approximate_rad - kApproximateAtan2ErrorRad) / cell_rad;
    const double to = (approximate_rad + kApproximateAtan2ErrorRad) / cell_rad;
    const double number = from > 0.0 ? static_cast<double>(static_cast<std::size_t>(from)) : -1.0;
    return static_cast<std::size_t>(number >= 0.0 && to < number + 1.0 ? number
                                                                       : exact_rad() / cell_rad);
  };
  const Eigen::Vector3d q = p.cast<double>();
  const std::size_t column = number_of(ApproximateAtan2(q.y(), q.x()) + M_PI, column_rad_,
                                       [&] { return unlidar::AzimuthRad(p) + M_PI; });
  const std::size_t row = number_of(ApproximateAtan2(q.z(), q.head<2>().norm()) + M_PI / 2,
                                    row_rad_, [&] { return unlidar::ElevationRad(p) + M_PI / 2; });
  return std::min(row, rows_ - 1) * columns_ + std::min(column, columns_ - 1);
}

}  // namespace unlidar
