// What may hang on something too thin to be seen.
#pragma once

#include "base/recording.hpp"

namespace unlidar {

// Whether a target stands still so far away that a cable which holds it would not be seen. What
// hovers wanders by more than its returns scatter; what hangs stays, or swings about one place.
// `target`: with at least one measurement.
bool MayHang(const Target& target);

}  // namespace unlidar
