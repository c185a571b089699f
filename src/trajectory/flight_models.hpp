// Models of the flight of drones, birds and bats from published numbers, without training.
//
// A second of flight is described by its ground speed, its climb and its lateral acceleration. Each
// model states, for each of the three, the distribution of its values and how fast they change: a
// Markov chain on a grid of values. docs/kinds.md has the numbers with their sources.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace unlidar {

// Cues that describe a second of flight, in m/s, m/s and m/s^2.
inline constexpr std::size_t kNumCues = 3;
enum class Cue : std::size_t { kSpeed, kClimb, kTurn };

inline constexpr std::size_t kNumFlightClasses = 3;
enum class FlightClass : std::size_t { kDrone, kBirdLike, kUnknown };

// Dynamics of a cue on its grid of values.
struct MarkovChain {
  std::vector<double> shares;              // (grid) stationary distribution
  std::vector<std::vector<double>> steps;  // (grid, grid) transitions within a second
};

struct FlightModel {
  FlightClass flight_class;
  double share;  // among those of its class
  std::array<MarkovChain, kNumCues> chains;
};

const std::vector<FlightModel>& FlightModels();

// Sets `likelihoods` (grid of the cue) of the measured value given each true one, up to a common
// factor. The ground speed is the length of a vector and follows Rice's distribution.
void SetLikelihoodsOfSpeed(double speed_mps, double variance, std::vector<double>* likelihoods);
// `cue`: climb or turn.
void SetLikelihoodsOf(Cue cue, double measured, double variance, std::vector<double>* likelihoods);

// Scales shares to a sum of 1. Their sum must be above 0.
void Normalise(std::vector<double>* shares);

}  // namespace unlidar
