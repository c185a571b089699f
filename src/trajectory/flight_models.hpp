// Stated models of how drones, birds and bats fly, which nothing was trained for.
//
// A second of flight is described by its ground speed, its climb and its lateral acceleration. Each
// model says, for each of the three, how often which value occurs and how fast it changes: a Markov
// chain on a grid of values. docs/kinds.md has the numbers with their sources.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace unlidar {

// What describes a second of flight: m/s, m/s and m/s^2.
inline constexpr std::size_t kNumCues = 3;
enum class Cue : std::size_t { kSpeed, kClimb, kTurn };

inline constexpr std::size_t kNumFlightClasses = 3;
enum class FlightClass : std::size_t { kDrone, kBirdLike, kUnknown };

// How a cue behaves, on its grid of values.
struct MarkovChain {
  std::vector<double> shares;              // (grid) how often which value occurs
  std::vector<std::vector<double>> steps;  // (grid, grid) from each value to each within a second
};

struct FlightModel {
  FlightClass flight_class;
  double share;  // among those of its class
  std::array<MarkovChain, kNumCues> chains;
};

const std::vector<FlightModel>& FlightModels();

// Sets `likelihoods` (grid of the cue): how likely a value is measured, with this variance, for
// each true one, but for a common factor. The ground speed is the length of a vector: Rice's law.
void SetLikelihoodsOfSpeed(double speed_mps, double variance, std::vector<double>* likelihoods);
// `cue`: climb or turn.
void SetLikelihoodsOf(Cue cue, double measured, double variance, std::vector<double>* likelihoods);

// Makes shares add up to 1. Their sum must be above 0.
void Normalise(std::vector<double>* shares);

}  // namespace unlidar
