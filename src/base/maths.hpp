// Small maths and statistical constants of several layers.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace unlidar {

template <class Number>
constexpr Number Square(Number x) {
  return x * x;
}

// Returns the logarithm of the sum of the exponentials of at least one value.
template <class Values>
double LogSum(const Values& logs) {
  const double most = *std::max_element(logs.begin(), logs.end());
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(log - most);
  return most + std::log(sum);
}

// Alternatives less likely than the best by a larger log ratio are ignored: they change no
// probability by 1e-5.
constexpr double kNegligibleLog = 12.0;

// Count that Jeffreys' prior of a Poisson rate is worth.
constexpr double kJeffreysCount = 0.5;

// A symmetric matrix of three dimensions, stored as one half in single precision. For what is kept
// of very many: a third of the memory of a matrix.
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
