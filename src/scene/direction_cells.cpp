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

std::size_t DirectionCells::CellOf(const Eigen::Vector3f& p) const {
  const std::size_t column = AzimuthCell(p, column_rad_);
  const Eigen::Vector3d q = p.cast<double>();
  const std::size_t row =
      CellOfAngle(ApproximateAtan2(q.z(), q.head<2>().norm()) + M_PI / 2, row_rad_,
                  [&] { return unlidar::ElevationRad(p) + M_PI / 2; });
  return std::min(row, rows_ - 1) * columns_ + std::min(column, columns_ - 1);
}

}  // namespace unlidar
