// Smooth trajectory of a target: a robust cubic B-spline in time, with consistent sigmas.
//
// Between the measurements the target is assumed to accelerate as in Singer's model (1970):
// a' = -a / tau + white noise, with standard deviation sigma_a of a. The spline minimises
//   sum rho(|R^-1/2 (x(t_i) - z_i)|^2 / k^2)
//     + tau / (2 sigma_a^2) * integral |a' + a / tau|^2 dt + |a(t_0)|^2 / sigma_a^2,
// whose last two terms equal integral(|a'|^2 tau + |a|^2 / tau) dt / (2 sigma_a^2) and boundary
// terms. sigma_a, tau and the noise scale k are estimated by marginal likelihood (REML, because
// position and velocity at t_0 are nearly free): multicopters change their acceleration within half
// a second, on smooth flights it lasts for four. rho is truncated. sigma_a varies along the flight
// and with direction (trajectory_fitter.hpp).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "trajectory/banded.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Typical correlation time of the acceleration: tau of Singer's model.
inline constexpr double kTypicalAccelerationTimeS = 1.0;

// Scales of the manoeuvres and of the measurement noise.
struct TrajectoryScales {
  double acceleration_mps2 = 0.0;                          // sigma_a
  double noise = 1.0;                                      // k
  double acceleration_time_s = kTypicalAccelerationTimeS;  // tau
};

struct Trajectory {
  TrajectoryScales scales;
  std::vector<double> weights;  // (measurements) 1: used in full ... 0: an outlier
  MinimumReport minimum;

  // Times are relative to the first measurement, positions to origin_m: no digits are lost with
  // Unix times or UTM.
  TimeNs origin_ns = 0;
  TimeNs duration_ns = 0;
  Eigen::Vector3d origin_m = Eigen::Vector3d::Zero();
  std::vector<double> knots_s;
  // (intervals) sigma_a between knots i + 3 and i + 4 over that of scales, a symmetric matrix,
  // because it differs along and across the direction of flight.
  std::vector<Eigen::Matrix3d> agility;
  std::vector<Eigen::Vector3d> control_points_m;
  BandedMatrix covariance_m2;  // of the coordinates of neighbouring control points

  TimeNs begin_ns() const { return origin_ns; }  // first and last measurement
  TimeNs end_ns() const { return origin_ns + duration_ns; }

  // Returns position, velocity and sigma at a time; support and track_id are 0. Outside of
  // [begin_ns, end_ns] the sigma grows: by the model up to max_extrapolation_s, beyond that by the
  // last cubic.
  TrajectoryRow At(TimeNs time_ns) const;

  // (3, 3) covariance of the position at a time, m^2.
  Eigen::Matrix3d CovarianceAt(TimeNs time_ns) const;
};

// Fits measurements as TrajectoryFitter::Fit() does, with the minimum refined by Ceres: for what is
// written of recordings.
Trajectory FitTrajectoryByCeres(const std::vector<Measurement>& measurements,
                                const TrajectoryConfig& config);

// Errors that all measurements of a target have in common: no mean is free of them.
struct CommonErrors {
  double depth_sigma_m = 0.0;      // along their rays
  double elevation_sigma_m = 0.0;  // across them, upwards
  double time_sigma_s = 0.0;       // of their times, see FrameTiming
};

// Returns the errors of a target that consists of two parts.
inline CommonErrors LargerErrors(const CommonErrors& a, const CommonErrors& b) {
  return {std::max(a.depth_sigma_m, b.depth_sigma_m),
          std::max(a.elevation_sigma_m, b.elevation_sigma_m),
          std::max(a.time_sigma_s, b.time_sigma_s)};
}

// Target found by either method, with the trajectory that is written of it.
struct Target {
  std::vector<Measurement> measurements;  // in time order
  std::vector<std::uint32_t> returns;     // indices into the recording, ascending
  CommonErrors common_errors;
  std::vector<AlternativeMode> alternative_modes;  // in time order
  TimeNs time_bias_ns = 0;  // true minus recorded time of its returns, on average
  double score = 0.0;       // track score (robust) or psi (paper)
  Trajectory trajectory;    // fitted to the measurements once they are final
};

}  // namespace unlidar
