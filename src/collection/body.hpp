// The size of a target as a sensor sees it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// How far returns spread about the position of their target, as standard deviations: along the ray
// (only the side that faces the sensor is seen), across it on the level, and across both. Most
// drones are wider than high.
struct BodySigmas {
  double depth_m = 0.0;
  double width_m = 0.0;
  double height_m = 0.0;
};

// Their covariance where the ray has a direction; z is up.
Eigen::Matrix3d BodyCovarianceM2(const BodySigmas& body, const Eigen::Vector3d& ray_m);

// How far the target moves while the returns of a frame, whose own times are not known, arrive.
Eigen::Matrix3d StreakM2(const FrameInfo& frame, const Eigen::Vector3d& velocity_mps);

// What the returns of a target say of its size. A few returns of a size of sigma_m to begin with.
// Streaks are taken off, but a sensor may pass over a target at once and draw none: where they are
// long, no size is smaller than what is seen across them.
class BodySpread {
 public:
  explicit BodySpread(double sigma_m);

  // Returns of one frame, by their indices; expected: where the target is in the middle of it.
  void Add(const Recording& recording, const FrameInfo& frame, const Eigen::Vector3d& viewpoint_m,
           const std::vector<std::uint32_t>& returns, const TrajectoryRow& expected);

  BodySigmas Sigmas() const;

 private:
  double variance_m2_;
  Eigen::Array3d sums_m2_;  // depth, width, height
  Eigen::Array3d weights_;
  double across_m2_ = 0.0;
  double count_;
};

}  // namespace unlidar
