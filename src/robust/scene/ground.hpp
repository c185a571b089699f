// The ground under the scene, from the lowest returns.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <map>
#include <utility>

#include "base/recording.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Local lowest heights about one plane z = c0 + c1 x + c2 y. Without a ground in view (a sensor
// that looks up) every height above it is infinite.
class Ground {
 public:
  Ground(const PointsView& points_m, const GroundConfig& config);

  double HeightAbove(const Eigen::Vector3f& point_m) const;

  // Whether a return comes from the ground itself.
  bool Holds(const Eigen::Vector3f& point_m) const;

 private:
  std::pair<int, int> CellOf(double x_m, double y_m) const;

  GroundConfig config_;
  bool exists_ = false;
  Eigen::Vector3d plane_ = Eigen::Vector3d::Zero();
  std::map<std::pair<int, int>, double> cells_;
};

}  // namespace unlidar
