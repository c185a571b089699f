// Models of the flight of drones and of birds and bats from published numbers, without training.
//
// The seconds of one flight are no independent draws from its class: a flight has a style (cruise
// speed, share of hovering, spread of climb, level and direction of acceleration) and keeps it.
// Each class states how often which style occurs. The seconds of a track tell its style, and the
// class only as far as the classes differ in how often they fly like that: the log likelihood ratio
// is bounded, however long the track is. docs/kinds.md has the numbers with their sources.
#pragma once

#include <array>
#include <cstddef>

namespace unlidar {

// Cues that describe a second of flight: ground speed in m/s, vertical speed in m/s, and the
// horizontal acceleration along and across the velocity in m/s^2.
inline constexpr std::size_t kNumCues = 3;
enum class Cue : std::size_t { kSpeed, kClimb, kTurn };

// Log likelihoods of the styles of one flight, given the seconds added so far.
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

}  // namespace unlidar
