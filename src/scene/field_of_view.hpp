// Elevation limits of the field of view, estimated from returns.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace unlidar {

// Range of elevations as seen from the viewpoint; by default all.
struct ElevationRange {
  double lowest_rad = -M_PI / 2;
  double highest_rad = M_PI / 2;
};

// Lower and upper edge of the field of view. The sky yields no returns, so an edge is only known if
// the returns of many azimuths end at one elevation, as those of hills, roofs and trees do not.
class FieldOfView {
 public:
  FieldOfView();

  void Add(const Eigen::Vector3f& point_m);

  // Returns the edges in rad; an unknown edge is at -pi/2 or pi/2.
  ElevationRange Edges() const;

 private:
  static constexpr std::size_t kNumColumns = 72;

  // Sines of the lowest and highest elevations of all returns, and per azimuth column (exact only
  // near the overall bounds).
  float lowest_;
  float highest_;
  std::array<float, kNumColumns> lowest_of_;
  std::array<float, kNumColumns> highest_of_;
};

// Returns the elevation (rad) below which one return in a hundred of a station lies: near it, the
// legs of people are cut off. Unlike FieldOfView's lower edge it is always known, whether the
// sensor or the scene ends there, and a few returns below it, from a ditch, do not change it. Needs
// at least one point.
double LowestElevationRad(const std::vector<Eigen::Vector3f>& points_m);

}  // namespace unlidar
