// Cells of equal azimuth and elevation around a viewpoint.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/angles.hpp"

namespace unlidar {

// Resolution at which structure hides places behind it, in degrees.
constexpr double kHidingCellDeg = 2.0;

class DirectionCells {
 public:
  // `cell_deg`: edge of a cell, at most.
  explicit DirectionCells(double cell_deg)
      : columns_(static_cast<std::size_t>(std::ceil(360.0 / cell_deg))),
        rows_(static_cast<std::size_t>(std::ceil(180.0 / cell_deg))),
        column_rad_(2.0 * M_PI / static_cast<double>(columns_)),
        row_rad_(M_PI / static_cast<double>(rows_)) {}

  std::size_t columns() const { return columns_; }
  std::size_t rows() const { return rows_; }
  std::size_t size() const { return columns_ * rows_; }

  // Of the centre of a row or column.
  double RowRad(std::size_t row) const {
    return (static_cast<double>(row) + 0.5) * row_rad_ - M_PI / 2;
  }
  double ColumnRad(std::size_t column) const {
    return (static_cast<double>(column) + 0.5) * column_rad_ - M_PI;
  }

  // Returns the cell of a direction, row by row.
  std::size_t CellOf(const Eigen::Vector3f& p) const {
    const std::size_t column = AzimuthCell(p, column_rad_);
    const Eigen::Vector3d q = p.cast<double>();
    const std::size_t row = CellOfAngle(ApproximateAtan2(q.z(), q.head<2>().norm()) + M_PI / 2,
                                        row_rad_, [&] { return ElevationRad(p) + M_PI / 2; });
    return std::min(row, rows_ - 1) * columns_ + std::min(column, columns_ - 1);
  }

 private:
  std::size_t columns_;
  std::size_t rows_;
  double column_rad_;
  double row_rad_;
};

}  // namespace unlidar
