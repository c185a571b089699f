// How often a test draws.
#pragma once

namespace unlidar::testing {

// So many of `draws` random cases: all of them, or a tenth and at least one with sanitizers, which
// look at each step and not at statistics, and take ten times as long. Seeds, variants of one case
// and the returns of laws about effort are counted by it too.
template <typename Count>
constexpr Count Draws(Count draws) {
#ifdef UNLIDAR_SANITIZED
  return draws < Count{10} ? Count{1} : draws / Count{10};
#else
  return draws;
#endif
}

}  // namespace unlidar::testing
