// Tests for objects that hang from a cable too thin to be seen.
#pragma once

#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Longer than the period of most swings: means over this time are constant for a hanging object,
// not for a hovering drone.
constexpr double kSwingPeriodS = 3.0;

// True if a target stands still at a range where a cable that holds it would not be seen.
// `measurements`: at least one, in order of time, as for the functions below.
bool IsStaticFar(const std::vector<Measurement>& measurements);

// True if a static target moves by more than the scatter of its returns, as a hovering drone does;
// a hanging object stays, or swings about one place.
bool DriftsBeyondNoise(const std::vector<Measurement>& measurements);

// True if the target moves straight for longer than most swings last; a hanging object comes back.
bool MovesStraight(const std::vector<Measurement>& measurements);

// IsStaticFar() and not DriftsBeyondNoise().
inline bool MayBeSuspended(const std::vector<Measurement>& measurements) {
  return IsStaticFar(measurements) && !DriftsBeyondNoise(measurements);
}

}  // namespace unlidar
