#include "robust/tracking/flight.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace unlidar {
namespace {

constexpr double kHigh_m = 2.0;  // what is not known to be in the air has to be as high

RobustConfig Config() {
  RobustConfig config;
  config.off_ground_m = kHigh_m;
  config.false_alarms_per_recording = 1e-3;
  return config;
}

// Frames of some returns at some height, nothing below.
std::vector<Plot> PathAt(double height_m, int num_frames, std::uint32_t returns_per_frame) {
  Plot plot;
  plot.lowest_m = height_m;
  plot.num_returns = returns_per_frame;
  return std::vector<Plot>(static_cast<std::size_t>(num_frames), plot);
}

bool IsKnownToBeInTheAir(const std::vector<Plot>& path) {
  return OffGroundM(path, Config()) < kHigh_m;
}

TEST(Flight, WhatHasNothingBelowItInEnoughReturnsIsInTheAir) {
  EXPECT_TRUE(IsKnownToBeInTheAir(PathAt(1.4, 8, 3)));
  EXPECT_FALSE(IsKnownToBeInTheAir(PathAt(1.4, 5, 1)));
}

TEST(Flight, TheHigherItIsTheFewerReturnsItTakes) {
  int before = 1000;
  for (const double height_m : {0.8, 1.0, 1.3, 1.8}) {
    int num_frames = 1;
    while (!IsKnownToBeInTheAir(PathAt(height_m, num_frames, 1))) ++num_frames;
    EXPECT_LT(num_frames, before) << height_m;
    before = num_frames;
  }
}

// Where there is no room for legs none are missed.
TEST(Flight, WhatLiesOnTheGroundIsNeverInTheAir) {
  EXPECT_FALSE(IsKnownToBeInTheAir(PathAt(0.3, 1000, 10)));
}

// Heads and shoulders, their legs in two frames of three.
TEST(Flight, WhatStandsOnTheGroundIsNeverInTheAir) {
  for (const int num_frames : {9, 30, 300}) {
    for (const std::uint32_t returns_per_frame : {3U, 100U}) {
      std::vector<Plot> path = PathAt(1.3, num_frames, returns_per_frame);
      for (std::size_t i = 0; i < path.size(); ++i) path[i].num_below = i % 3 == 0 ? 0 : 4;
      EXPECT_FALSE(IsKnownToBeInTheAir(path)) << num_frames << ", " << returns_per_frame;
    }
  }
}

TEST(Flight, ACarThatPassesBelowOnceDoesNotMakeABody) {
  std::vector<Plot> path = PathAt(1.4, 10, 3);
  path[4].num_below = 60;
  EXPECT_TRUE(IsKnownToBeInTheAir(path));
}

}  // namespace
}  // namespace unlidar
