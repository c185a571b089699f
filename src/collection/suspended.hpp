// What may hang on something too thin to be seen.
#pragma once

#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Whether a target stands still so far away that a cable which holds it would not be seen.
// `measurements`: at least one, in order of time, also below.
bool IsStaticFar(const std::vector<Measurement>& measurements);

// Whether a target that stands moves by more than its returns scatter, as what hovers does: what
// hangs stays, or swings about one place.
bool DriftsBeyondNoise(const std::vector<Measurement>& measurements);

// Whether it goes straight on, for longer than most swings last: what hangs comes back.
bool MovesStraight(const std::vector<Measurement>& measurements);

// Whether it stands far away and does not wander.
bool MayBeSuspended(const std::vector<Measurement>& measurements);

}  // namespace unlidar
