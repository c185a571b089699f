// Distance of the centre of a body behind the returns of the side that faces the sensor.
#pragma once

#include <Eigen/Core>

namespace unlidar {

// Sums over the returns of one frame, of their offsets from their mean, in RayAxes().
struct FacingSums {
  double count = 0.0;
  double depth2_m2 = 0.0;   // along the ray
  double across2_m2 = 0.0;  // horizontally across it
  double across4_m4 = 0.0;
  double depth_across2_m3 = 0.0;

  void Add(const Eigen::Vector3d& offset_m);
};

// Share of the width of a body, one standard deviation of its returns across the ray.
struct FacingShare {
  double mean = 0.0;
  double sigma = 0.0;
};

// Tells round bodies from flat ones. The side that a ball shows recedes with the square of the
// distance from its middle, by 1 / (4 width), and its centre lies 1.33 widths behind the returns;
// plates, arms and rotors do not recede.
class FacingSide {
 public:
  // Adds a frame in which the target hardly moves, or whose returns have times.
  void Add(const FacingSums& sums);

  // Returns the distance of the centre behind the mean of the returns. `flat_share`: of a flat
  // body, which all are taken for until their returns tell.
  FacingShare Share(double width_m, double flat_share) const;

 private:
  double freedom_ = 0.0;
  double depth2_m2_ = 0.0;
  double variance_m4_ = 0.0;    // of the squares across, as a sum
  double covariance_m3_ = 0.0;  // of these and the depth
};

// Distance vector from the mean of the returns to the centre of a body behind it.
Eigen::Vector3d FacingSideOffsetM(double body_sigma_m, const Eigen::Vector3d& ray_m, double share);

}  // namespace unlidar
