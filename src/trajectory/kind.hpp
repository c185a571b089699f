// Classification of a track by its flight alone, with models of multicopters, birds and bats.
//
// Each whole second of a track, with the sigmas of its trajectory, is weighed by the styles of
// flight; Bayes' rule yields the probabilities of a drone and of a bird, the rest is unknown.
// docs/kinds.md has the accuracy on real flights.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>

#include "trajectory/trajectory.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Cues that describe a second of flight: ground speed in m/s, vertical speed in m/s, and the
// horizontal acceleration along and across the velocity in m/s^2.
inline constexpr std::size_t kNumCues = 3;
enum class Cue : std::size_t { kSpeed, kClimb, kTurn };

// Log likelihoods of the styles of one flight, given the seconds added so far.
//
// The seconds of one flight are no independent draws from its class: a flight has a style (cruise
// speed, share of hovering, spread of climb, level and direction of acceleration) and keeps it.
// Each class states how often which style occurs. The seconds of a track tell its style, and the
// class only as far as the classes differ in how often they fly like that: the log likelihood ratio
// is bounded, however long the track is. docs/kinds.md has the numbers with their sources.
class StyleLikelihoods {
 public:
  // The variance is that of the measured value along one axis.
  void AddSpeed(double speed_mps, double variance);
  void AddClimb(double climb_mps, double variance);
  void AddAcceleration(double along_mps2, double across_mps2, double variance);

  // Log likelihood ratio of drone to bird-like by all cues.
  double LogRatio() const;
  // By each cue alone. Not additive: what heights say depends on how the flight manoeuvres.
  std::array<double, kNumCues> LogRatios() const;

  static constexpr std::size_t kNumCruises = 8;
  static constexpr std::size_t kNumHovers = 3;
  static constexpr std::size_t kNumVariations = 3;
  static constexpr std::size_t kNumClimbs = 7;
  static constexpr std::size_t kNumLevels = 6;
  static constexpr std::size_t kNumDirections = 4;

 private:
  template <std::size_t kSize>
  using Logs = std::array<double, kSize>;

  Logs<kNumCruises* kNumHovers* kNumVariations> speed_logs_ = {};
  Logs<kNumClimbs> climb_logs_ = {};
  Logs<kNumLevels* kNumDirections> acceleration_logs_ = {};
};

// Kind of a track without evidence.
inline constexpr Kind kPriorKind = {0.25, 0.25, 0.5};

// Statistics of the flight of a track, and its kind.
struct FlightStatistics {
  Kind kind = kPriorKind;
  // (cues) Log likelihood ratio of drone to bird-like by each cue alone: above 0 for a drone. Not
  // additive: jointly, one style has to explain all three.
  std::array<double, kNumCues> log_ratios = {};
  double seconds = 0.0;       // number judged
  double hover_share = 0.0;   // share of them below 1 m/s over ground
  double wander_m = 0.0;      // RMS displacement in a second of hovering, 3-D; 0 if none
  double speed_mps = 0.0;     // mean ground speed
  double climb_mps = 0.0;     // RMS vertical speed
  double turn_mps2 = 0.0;     // RMS lateral acceleration
  double straightness = 0.0;  // distance of the ends over the path length; 0 to 1
};

// Filters the kind of one track, second by second, at constant memory and time per second.
class KindFilter {
 public:
  // Judges the whole seconds of the trajectory up to `until_ns` that were not judged yet, counted
  // from its first measurement. The trajectory may have been refitted since the last call.
  void Observe(const Trajectory& trajectory, TimeNs until_ns);

  const Kind& kind() const { return kind_; }
  FlightStatistics Describe() const;

 private:
  struct Instant {
    TimeNs time_ns = 0;
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
    double across_m2 = 0.0;  // variance of the position along a horizontal axis,
    double height_m2 = 0.0;  // and along the vertical one
  };

  static Instant InstantAt(const Trajectory& trajectory, TimeNs time_ns);
  void Update(const Instant& next);

  StyleLikelihoods styles_;
  Kind kind_ = kPriorKind;
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
