// Axes of the ray from a sensor to a place.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace unlidar {

// Unit vector across a ray, horizontal; any such one for a vertical ray.
inline Eigen::Vector3d AcrossRay(const Eigen::Vector3d& ray_m) {
  const Eigen::Vector3d across = Eigen::Vector3d::UnitZ().cross(ray_m).stableNormalized();
  return across.squaredNorm() < 0.5 ? Eigen::Vector3d(Eigen::Vector3d::UnitX()) : across;
}

// Axes of a ray, in columns: along it, across it horizontally, and across both, upwards.
inline Eigen::Matrix3d RayAxes(const Eigen::Vector3d& ray_m) {
  Eigen::Matrix3d axes;
  axes.col(0) = ray_m.stableNormalized();
  axes.col(1) = AcrossRay(axes.col(0));
  axes.col(2) = axes.col(0).cross(axes.col(1));
  return axes;
}

}  // namespace unlidar
