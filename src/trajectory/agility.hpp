// Time-varying, anisotropic agility: targets are calm for most of a flight and agile for some
// seconds, and accelerate more along their direction than across it. A single sigma_a would be too
// wide for calm flight and far too narrow for manoeuvres.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {

// Levels of sigma_a over that of the whole flight: an eighth to four, in half octaves.
inline constexpr int kAgilityLevels = 11;

// Driving noise of the acceleration in an interval, in units of the variance of the whole flight.
struct DrivingNoise {
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();    // of the fitted jerk
  Eigen::Matrix3d unknown = Eigen::Matrix3d::Zero();    // posterior covariance of the jerk
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // of flight; shorter if slow
};

// Buffers of AdaptAgility(), one entry per interval, kept for reuse.
struct AgilityMemory {
  using Levels = Eigen::Array<double, kAgilityLevels, 1>;
  std::vector<DrivingNoise> driving_noises;
  std::vector<Levels> likelihoods;
  std::vector<Levels> forward;
  std::vector<double> stay_probabilities;
  std::array<std::vector<double>, 3> variances;  // of each spread
};

// Sets the agility of each interval of the model (sigma_a there over that of the whole flight) to
// its posterior mean after a fit at the present agilities. The agility is a hidden Markov chain on
// a ladder of levels: a level is kept for half a second on average, and is then drawn anew. The
// spread of the levels is averaged over by the evidence for each spread; a uniform flight keeps its
// level. The evidence of an interval is the part of its jerks that the measurements determine
// (MacKay, 1992): none in a gap, where the agility is that of its ends and, farther off, the prior.
// The ratio of the variances along and across the direction is one number per flight, estimated
// from the same parts; a hover has no direction.
void AdaptAgility(const SplineFit& fit, const TrajectoryScales& scales,
                  const TrajectoryConfig& config, AgilityMemory& memory, SplineModel& model);

}  // namespace unlidar
