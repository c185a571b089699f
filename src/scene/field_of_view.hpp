// Where the sensors look, as far as their returns tell.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

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

// The elevation below which a station sees next to nothing, one return in a hundred: near it,
// people lack their legs. Beside the lower edge it is always known, whether the sensor ends there
// or the scene does, and a few returns below it, of a ditch, change nothing. Of at least one point.
double LowestElevationRad(const std::vector<Eigen::Vector3f>& points_m);

}  // namespace unlidar
