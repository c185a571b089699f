// How often a test draws.
#pragma once

namespace unlidar::testing {

// So many of `draws` random cases: all of them, or a fifth with sanitizers, which look at each step
// and not at statistics, and take ten times as long.
constexpr int Draws(int draws) {
#ifdef UNLIDAR_SANITIZED
  return draws / 5;
#else
  return draws;
#endif
}

}  // namespace unlidar::testing
