// The returns of a frame that watch over its sensor, where all would tell no more.
#pragma once

#include <cstddef>

namespace unlidar {

// Enough of a frame to watch over a sensor.
constexpr std::ptrdiff_t kWatchedReturns = 8192;

constexpr float kOwnRangeM = 1.0F;  // returns nearer than this are of the station itself

// Returns the step at which at most `most` of `count` are visited.
constexpr std::ptrdiff_t SampleStep(std::ptrdiff_t count, std::ptrdiff_t most) {
  return count <= most ? 1 : (count + most - 1) / most;
}

}  // namespace unlidar
