// Subsampling of frames for the checks of a sensor: its health, pose and sway.
#pragma once

#include <cstddef>

namespace unlidar {

// Returns of a frame that suffice for these checks.
constexpr std::size_t kWatchedReturns = 8192;

// Nearer returns are of the station itself, such as dirt on its window.
constexpr float kOwnRangeM = 1.0F;

// Returns the step at which at most `most` of `count` are visited.
constexpr std::size_t SampleStep(std::size_t count, std::size_t most) {
  return count <= most ? 1 : (count + most - 1) / most;
}

}  // namespace unlidar
