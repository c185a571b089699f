// The ground under the scene, from the lowest returns.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <map>
#include <utility>

#include "base/recording.hpp"

namespace unlidar {

struct GroundConfig {
  double cell_m = 4.0;
  double quantile = 0.05;     // of the heights in a cell
  int min_returns = 10;       // in a cell
  int min_cells = 6;          // fewer show no ground
  double plane_band_m = 0.6;  // cells this near to the plane make it
  double max_slope = 0.3;     // a steeper plane is a wall or a crown
  double max_rise_m = 0.5;    // above the plane; more is a bush, a car or the station itself
  double max_relief_m = 1.5;  // a cell farther from the plane is not ground
  double thickness_m = 0.3;   // what is lower is ground: grass, noise
};

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
