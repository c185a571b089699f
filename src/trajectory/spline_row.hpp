// One residual of a spline fit, of a measurement or of the smoothness, and its derivatives; shared
// by the banded solver and Ceres.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

namespace unlidar {

// r = S (sum_j b_j c_j - z) of four neighbouring control points c_j, so that dr/dc_j = b_j S, with
// S = sqrt_information and z = value_m.
struct SplineRow {
  int first = 0;  // index of c_0
  Eigen::Vector4d basis = Eigen::Vector4d::Zero();
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Identity();
  Eigen::Vector3d value_m = Eigen::Vector3d::Zero();
};

// `control`: the coordinates of each c_j.
inline Eigen::Vector3d Residual(const SplineRow& row, const double* const* control) {
  Eigen::Vector3d position = -row.value_m;
  for (int j = 0; j < 4; ++j) {
    position += row.basis[j] * Eigen::Map<const Eigen::Vector3d>(control[j]);
  }
  return row.sqrt_information * position;
}

// `control`: all control points of the spline.
inline Eigen::Vector3d Residual(const SplineRow& row, const std::vector<Eigen::Vector3d>& control) {
  const Eigen::Vector3d* const own = &control[static_cast<std::size_t>(row.first)];
  const std::array<const double*, 4> coordinates = {own[0].data(), own[1].data(), own[2].data(),
                                                    own[3].data()};
  return Residual(row, coordinates.data());
}

inline Eigen::Matrix3d Jacobian(const SplineRow& row, int j) {
  return row.basis[j] * row.sqrt_information;
}

}  // namespace unlidar
