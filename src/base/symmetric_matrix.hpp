// A symmetric matrix of three dimensions, stored as one half in single precision.
#pragma once

#include <Eigen/Core>
#include <array>

namespace unlidar {

// For what is kept of very many: a third of the memory of a matrix.
class SymmetricMatrix {
 public:
  SymmetricMatrix() = default;
  explicit SymmetricMatrix(const Eigen::Matrix3d& m)
      : half_{static_cast<float>(m(0, 0)), static_cast<float>(m(0, 1)),
              static_cast<float>(m(0, 2)), static_cast<float>(m(1, 1)),
              static_cast<float>(m(1, 2)), static_cast<float>(m(2, 2))} {}

  Eigen::Matrix3d Full() const {
    Eigen::Matrix3f m;
    m << half_[0], half_[1], half_[2],  //
        half_[1], half_[3], half_[4],   //
        half_[2], half_[4], half_[5];
    return m.cast<double>();
  }

 private:
  std::array<float, 6> half_{};  // row by row from the diagonal on
};

}  // namespace unlidar
