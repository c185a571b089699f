// The size of a target as a sensor sees it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/maths.hpp"
#include "base/recording.hpp"
#include "collection/facing_side.hpp"

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

// Standard deviation of a return from the width of its beam, per metre of range.
constexpr double kBeamSigmaRad = 0.002;
// The mean of a frame's returns varies by this much per axis, as different parts of the body are
// hit.
constexpr double kCentreSigmaM = 0.04;

// Covariance of one return about its target, in world axes.
Eigen::Matrix3d ReturnCovarianceM2(const BodySigmas& body, const Eigen::Vector3d& ray_m);

// Covariance of the mean of `num_returns` returns of a frame about its target, in world axes.
// `streak_m2`: of the frame, see StreakM2().
Eigen::Matrix3d MeasurementCovarianceM2(const BodySigmas& body, const Eigen::Vector3d& ray_m,
                                        const Eigen::Matrix3d& streak_m2, double num_returns);

// Variance of the height of the centre about the beams that hit it, which are `beam_step_m` apart
// and the same in all frames: they meet the body anywhere within a step, or within its height where
// that is less. Multicopters are half as high as wide.
double ElevationVarianceM2(double beam_step_m, double body_sigma_m);

// Covariance of the streak: motion of the target during a frame without point times; zero with
// them. `length_s`: of the time in which the returns may have been measured.
Eigen::Matrix3d StreakM2(const FrameInfo& frame, const Eigen::Vector3d& velocity_mps);
Eigen::Matrix3d StreakM2(double length_s, const Eigen::Vector3d& velocity_mps);

// Weight of the squared offsets of returns in an estimate of the size of their target: the square
// of the share of their variance that is due to the body, not to the streak.
inline double BodyWeight(double body_m2, double streak_m2) {
  return Square(body_m2 / (body_m2 + streak_m2));
}

// True if a target moves so little while its returns are measured that they show its shape.
// `moved_m2`: variance of that motion across the ray.
inline bool ShowsShape(double body_m2, double moved_m2) { return moved_m2 < 0.1 * body_m2; }

// Number of returns that the prior of the size of a target is worth.
constexpr double kBodyPriorReturns = 10.0;

// Estimates size and shape of a target from its returns, the size with a prior of a few returns of
// size sigma_m. Streaks are subtracted; but a sensor may pass over a target at once and draw none,
// so for long streaks no size is smaller than the spread across them.
class BodySpread {
 public:
  explicit BodySpread(double sigma_m);

  // `returns`: those of one frame, as indices into the recording. `expected`: the target at its
  // middle.
  void Add(const Recording& recording, const FrameInfo& frame, const Eigen::Vector3d& viewpoint_m,
           const std::vector<std::uint32_t>& returns, const TrajectoryRow& expected);

  BodySigmas Sigmas() const;
  const FacingSide& facing_side() const { return facing_side_; }

 private:
  double variance_m2_;
  Eigen::Array3d sums_m2_;  // depth, width, height
  Eigen::Array3d weights_;
  double across_m2_ = 0.0;
  double count_;
  FacingSide facing_side_;
  std::vector<Eigen::Vector3d> offsets_m_;  // buffer: of the returns of a frame, in ray axes
};

}  // namespace unlidar
