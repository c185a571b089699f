// Stop and go: a target that is calm for most of a flight and agile for some seconds of it, and
// that goes faster or slower along its direction more than it leaves it. One sigma_a for the whole
// would be too wide for the calm and far too narrow for the rest.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {

// Levels of sigma_a over that of the whole flight: an eighth to four, in half octaves.
inline constexpr int kAgilityLevels = 11;

// What driving_noises the acceleration in an interval, in units of the variance of the whole
// flight.
struct DrivingNoise {
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();  // of what was fitted
  Eigen::Matrix3d unknown = Eigen::Matrix3d::Zero();  // and what is not known of it, its covariance
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // direction of flight; shorter where slow
};

// What AdaptAgility() works with, (intervals), kept for the next time.
struct AgilityMemory {
  using Levels = Eigen::Array<double, kAgilityLevels, 1>;
  std::vector<DrivingNoise> driving_noises;
  std::vector<Levels> likelihoods;
  std::vector<Levels> forward;
  std::vector<double> stay_probabilities;
  std::array<std::vector<double>, 3> variances;  // of each spread
};

// Sets the agility of each interval of the model, sigma_a there over that of the whole flight, to
// what is known of it after a fit at the agilities it has so far. The agility is a hidden Markov
// chain on a ladder of levels: it stay_probabilities for half a second on average, and is then
// drawn anew. How far the levels of this flight spread is averaged over, too, by the evidence for
// each spread; a flight that is the same all along keeps its level. What an interval tells of its
// level is the part of its jerks that the measurements determine (MacKay, 1992): in a gap that is
// nothing, and the agility is that of its ends and, farther off, that of any time. How much larger
// the variance is along the direction than across it is one number for the flight, told by the same
// parts; a hover has no direction.
void AdaptAgility(const SplineFit& fit, const TrajectoryScales& scales, AgilityMemory& memory,
                  SplineModel& model);

}  // namespace unlidar
