// Small maths and statistical constants of several layers.
#pragma once

#include <algorithm>
#include <cmath>

namespace unlidar {

template <class Number>
constexpr Number Square(Number x) {
  return x * x;
}

// Returns the logarithm of the sum of the exponentials of at least one value.
template <class Values>
double LogSum(const Values& logs) {
  const double most = *std::max_element(logs.begin(), logs.end());
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(log - most);
  return most + std::log(sum);
}

// Alternatives less likely than the best by a larger log ratio are ignored: they change no
// probability by 1e-5.
constexpr double kNegligibleLog = 12.0;

// Count that Jeffreys' prior of a Poisson rate is worth.
constexpr double kJeffreysCount = 0.5;

}  // namespace unlidar
