// Angles of directions, in double: C libraries round their functions of floats differently on
// different processors, and hypot, cbrt and exp2 of any width.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace unlidar {

// From -pi to pi, 0 along x.
inline double AzimuthRad(const Eigen::Vector3f& p) {
  return std::atan2(static_cast<double>(p.y()), static_cast<double>(p.x()));
}

// From -pi / 2 to pi / 2.
inline double ElevationRad(const Eigen::Vector3f& p) {
  return std::atan2(static_cast<double>(p.z()), p.head<2>().cast<double>().norm());
}

}  // namespace unlidar
