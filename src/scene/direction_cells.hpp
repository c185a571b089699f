// Cells of equal azimuth and elevation around a viewpoint.
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace unlidar {

// Resolution at which structure hides places behind it, in degrees.
constexpr double kHidingCellDeg = 2.0;

class DirectionCells {
 public:
  // `cell_deg`: edge of a cell, at most.
  explicit DirectionCells(double cell_deg);

  std::size_t columns() const { return columns_; }
  std::size_t rows() const { return rows_; }
  std::size_t size() const { return columns_ * rows_; }
  double ElevationRad(std::size_t row) const;  // of the centre
  double AzimuthRad(std::size_t column) const;

  // Returns the cell of a direction, row by row.
  std::size_t CellOf(const Eigen::Vector3f& point_m) const;

 private:
  std::size_t columns_;
  std::size_t rows_;
  double column_rad_;
  double row_rad_;
};

}  // namespace unlidar
