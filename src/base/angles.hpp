// Azimuth and elevation, in double for reproducible results: C libraries round the float functions
// differently per processor, and hypot, cbrt and exp2 at any precision.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>

namespace unlidar {

constexpr double kRadPerDeg = M_PI / 180.0;

// Returns the azimuth in [-pi, pi], 0 along x.
inline double AzimuthRad(const Eigen::Vector3f& p) {
  return std::atan2(static_cast<double>(p.y()), static_cast<double>(p.x()));
}

// Returns the elevation in [-pi / 2, pi / 2].
inline double ElevationRad(const Eigen::Vector3f& p) {
  return std::atan2(static_cast<double>(p.z()), p.head<2>().cast<double>().norm());
}

// Returns std::atan2 to within kApproximateAtan2ErrorRad in a fifth of its time; 0 at the origin.
// Abramowitz and Stegun, Handbook of Mathematical Functions, 4.4.49.
constexpr double kApproximateAtan2ErrorRad = 2e-5;
inline double ApproximateAtan2(double y, double x) {
  const double width = std::abs(x);
  const double height = std::abs(y);
  const double longer = width > height ? width : height;
  if (longer == 0.0) return 0.0;
  const double ratio = (width > height ? height : width) / longer;
  const double r2 = ratio * ratio;
  double rad = ratio * (0.9998660 +
                        r2 * (-0.3302995 + r2 * (0.1801410 + r2 * (-0.0851330 + r2 * 0.0208351))));
  if (height > width) rad = M_PI / 2 - rad;
  if (x < 0.0) rad = M_PI - rad;
  return y < 0.0 ? -rad : rad;
}

// Returns the number of the cell of an angle from 0 on, of which exact_rad() is computed only where
// the approximate one is near the edge of a cell.
template <class ExactRad>
std::size_t CellOfAngle(double approximate_rad, double cell_rad, const ExactRad& exact_rad) {
  const double from = (approximate_rad - kApproximateAtan2ErrorRad) / cell_rad;
  const double to = (approximate_rad + kApproximateAtan2ErrorRad) / cell_rad;
  const double number = from > 0.0 ? static_cast<double>(static_cast<std::size_t>(from)) : -1.0;
  return static_cast<std::size_t>(number >= 0.0 && to < number + 1.0 ? number
                                                                     : exact_rad() / cell_rad);
}

// Returns the number of the cell of the azimuth of a point, from -pi on.
inline std::size_t AzimuthCell(const Eigen::Vector3f& p, double cell_rad) {
  return CellOfAngle(
      ApproximateAtan2(static_cast<double>(p.y()), static_cast<double>(p.x())) + M_PI, cell_rad,
      [&] { return AzimuthRad(p) + M_PI; });
}

// Azimuths of 5 degrees each, from -pi on.
constexpr std::size_t kAzimuthColumns = 72;

inline std::size_t AzimuthColumn(const Eigen::Vector3f& p) {
  constexpr double kColumnRad = 2.0 * M_PI / static_cast<double>(kAzimuthColumns);
  return std::min(AzimuthCell(p, kColumnRad), kAzimuthColumns - 1);
}

// Cells of equal azimuth and elevation around a viewpoint, of 2 degrees: the resolution at which
// structure hides places behind it.
struct DirectionCells {
  static constexpr std::size_t kColumns = 180;
  static constexpr std::size_t kRows = 90;
  static constexpr std::size_t kCount = kRows * kColumns;
  static constexpr double kCellRad = M_PI / static_cast<double>(kRows);

  // Of the centre of a row or column.
  static double RowRad(std::size_t row) {
    return (static_cast<double>(row) + 0.5) * kCellRad - M_PI / 2;
  }
  static double ColumnRad(std::size_t column) {
    return (static_cast<double>(column) + 0.5) * kCellRad - M_PI;
  }

  // Returns the cell of a direction, row by row.
  static std::size_t CellOf(const Eigen::Vector3f& p) {
    const std::size_t column = AzimuthCell(p, kCellRad);
    const Eigen::Vector3d q = p.cast<double>();
    const std::size_t row = CellOfAngle(ApproximateAtan2(q.z(), q.head<2>().norm()) + M_PI / 2,
                                        kCellRad, [&] { return ElevationRad(p) + M_PI / 2; });
    return std::min(row, kRows - 1) * kColumns + std::min(column, kColumns - 1);
  }
};

}  // namespace unlidar
