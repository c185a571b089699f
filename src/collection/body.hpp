// The size of a target as a sensor sees it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Standard deviations of returns about the position of their target: along the ray (only the facing
// side is seen), across it horizontally, and across both. Most drones are wider than high.
struct BodySigmas {
  double depth_m = 0.0;
  double width_m = 0.0;
  double height_m = 0.0;
};

// Covariance in world axes (z up) for a ray from the sensor.
Eigen::Matrix3d BodyCovarianceM2(const BodySigmas& body, const Eigen::Vector3d& ray_m);

// Covariance of the streak: motion of the target during a frame without point times; zero with
// them.
Eigen::Matrix3d StreakM2(const FrameInfo& frame, const Eigen::Vector3d& velocity_mps);

// Estimates the size of a target from its returns, with a prior of a few returns of size sigma_m.
// Streaks are subtracted; but a sensor may pass over a target at once and draw none, so for long
// streaks no size is smaller than the spread across them.
class BodySpread {
 public:
  explicit BodySpread(double sigma_m);

  // `returns`: those of one frame, as indices into the recording. `expected`: the target at its
  // middle.
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
