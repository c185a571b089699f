// The neighbourhoods of RangeGrid from their definition, point by point.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "scene/range_grid.hpp"

namespace unlidar::testing {

// Radius of the shell of a point: the nearest power of sqrt(2) times the constant.
inline double SteppedRadiusM(const RangeRadius& radius, const Eigen::Vector3f& point_m) {
  const double ratio = radius.At(static_cast<double>(point_m.norm())) / radius.constant_m;
  return radius.constant_m * std::pow(2.0, std::floor(2.0 * std::log2(ratio) + 0.5) / 2.0);
}

// Whether `other` lies in the block of 3 x 3 x 3 voxels about `point_m`.
inline bool IsNeighbour(const RangeRadius& radius, const Eigen::Vector3f& point_m,
                        const Eigen::Vector3f& other_m) {
  const double edge_m = SteppedRadiusM(radius, point_m) * 2.0 / 3.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double from = std::floor(static_cast<double>(point_m[axis]) / edge_m);
    const double to = std::floor(static_cast<double>(other_m[axis]) / edge_m);
    if (std::abs(to - from) > 1.0) return false;
  }
  return true;
}

inline double BlockVolumeM3(const RangeRadius& radius, const Eigen::Vector3f& point_m) {
  return std::pow(2.0 * SteppedRadiusM(radius, point_m), 3);
}

}  // namespace unlidar::testing
