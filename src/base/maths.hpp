// Small maths and statistical constants of several layers.
#pragma once

namespace unlidar {

template <class Number>
constexpr Number Square(Number x) {
  return x * x;
}

// Alternatives less likely than the best by a larger log ratio are ignored: they change no
// probability by 1e-5.
constexpr double kNegligibleLog = 12.0;

// Count that Jeffreys' prior of a Poisson rate is worth.
constexpr double kJeffreysCount = 0.5;

}  // namespace unlidar
