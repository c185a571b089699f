// What a track is, judged by how it flies alone: multicopters, birds and bats by stated models.
//
// The forward algorithm gives how likely the seconds of a track are under each model of flight,
// with the sigmas of its trajectory; a kind is a mixture of models, and Bayes' rule the rest. So a
// speed that is held counts little more than once, and what is measured badly says little.
// docs/kinds.md has how well real flights are told apart.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "trajectory/flight_models.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Before anything is seen.
inline constexpr Kind kPriorKind = {0.25, 0.25, 0.5};

// How a track flew, and what that says.
struct FlightStatistics {
  Kind kind = kPriorKind;
  // (cues) Log likelihood ratio of drone to bird-like by each cue alone: above 0 for a drone. They
  // need not add up: together, one model has to explain all three.
  std::array<double, kNumCues> log_ratios = {};
  double seconds = 0.0;       // that were judged
  double hover_share = 0.0;   // of them, with less than 1 m/s across the ground
  double wander_m = 0.0;      // RMS way within a second of hovering, 3-D; 0 without any
  double speed_mps = 0.0;     // mean ground speed
  double climb_mps = 0.0;     // RMS vertical speed
  double turn_mps2 = 0.0;     // RMS lateral acceleration
  double straightness = 0.0;  // distance of the ends over the length of the way; 0 to 1
};

// Follows one track, second by second. Memory and time per second are constant.
class KindFilter {
 public:
  KindFilter();

  // Judges the whole seconds of the trajectory up to `until_ns` that were not judged yet, beginning
  // with its first measurement. It may have been fitted anew since the last call.
  void Observe(const Trajectory& trajectory, TimeNs until_ns);

  Kind kind() const;
  FlightStatistics Describe() const;

 private:
  struct Instant {
    TimeNs time_ns = 0;
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
    double across_m2 = 0.0;  // variance of the position along a horizontal axis,
    double height_m2 = 0.0;  // and along the vertical one
  };

  // The forward algorithm of one model and cue.
  struct CuePosterior {
    std::vector<double> shares;  // (grid) of each value, in view of all that was seen
    double log_likelihood = 0.0;
  };

  static Instant InstantAt(const Trajectory& trajectory, TimeNs time_ns);
  void Update(const Instant& next);
  void UpdateCue(Cue cue);

  std::vector<std::array<CuePosterior, kNumCues>> posteriors_;  // (models)
  std::vector<double> likelihoods_;                             // (grid) of what is taken in next
  std::vector<double> next_;  // (grid) shares of a posterior after it
  std::optional<Instant> last_;
  std::optional<Instant> before_;  // a second earlier
  Eigen::Vector3d first_m_ = Eigen::Vector3d::Zero();
  double seconds_ = 0.0;
  double turns_ = 0.0;  // seconds with one before
  double hover_s_ = 0.0;
  double hover_sum_m2_ = 0.0;
  double speed_sum_mps_ = 0.0;
  double climb_sum_ = 0.0;  // of squares,
  double turn_sum_ = 0.0;   // too
  double path_length_m_ = 0.0;
};

}  // namespace unlidar
