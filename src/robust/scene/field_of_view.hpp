// Where the sensors look, as far as their returns tell.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>

namespace unlidar {

// Elevations of directions, as seen from the viewpoint: all of them by default.
struct ElevationRange {
  double lowest_rad = -M_PI / 2;
  double highest_rad = M_PI / 2;
};

// The lower and the upper edge of the field of view. The sky returns nothing, so an edge is only
// known where returns of many azimuths end at one elevation: hills, roofs and trees do not.
class FieldOfView {
 public:
  FieldOfView();

  void Add(const Eigen::Vector3f& point_m);

  // An edge that is not known is at -pi/2 or pi/2.
  ElevationRange Edges() const;

 private:
  static constexpr std::size_t kNumColumns = 72;

  // Sines of the elevations that bound the returns, and by azimuth, exact where they are sharp.
  float lowest_;
  float highest_;
  std::array<float, kNumColumns> lowest_of_;
  std::array<float, kNumColumns> highest_of_;
};

}  // namespace unlidar
