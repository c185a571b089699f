// Strays of weather, and the groups of them that single linkage joins by chance.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace unlidar {

// Rate of strays, in returns per frame and m^3.
struct StrayRate {
  double usual = 0.0;    // over all times
  double present = 0.0;  // of late
};

// Returns the rate of groups of `count` strays, per m^3 and frame, of a Poisson process of `rate`
// returns per m^3 and frame that are joined within `radius_m`: with mu others within reach of each,
// the group of one of them is as large as the progeny of a branching process (Borel 1942),
//
//     rate / n exp(-mu n) (mu n)^(n - 1) / n!
//
// Infinite from mu = 1 on, where chains need not end.
inline double StrayGroupRate(double rate, double radius_m, double count) {
  const double mu = rate * 4.0 / 3.0 * M_PI * radius_m * radius_m * radius_m;
  if (mu >= 1.0) return std::numeric_limits<double>::infinity();
  if (mu <= 0.0) return 0.0;
  return rate / count *
         std::exp(-mu * count + (count - 1.0) * std::log(mu * count) - std::lgamma(count + 1.0));
}

// Returns the rate of all groups that are each rarer than `max_rate`, per m^3 and frame. The rate
// of groups of any size is rate (1 - mu / 2), and the larger, the rarer they are.
inline double RareStrayGroupRate(double rate, double radius_m, double max_rate) {
  const double mu = rate * 4.0 / 3.0 * M_PI * radius_m * radius_m * radius_m;
  if (mu >= 1.0) return 0.0;
  double rare = rate * (1.0 - 0.5 * mu);
  for (double count = 1.0;; count += 1.0) {
    const double of_count = StrayGroupRate(rate, radius_m, count);
    if (of_count < max_rate) return std::max(rare, 0.0);
    rare -= of_count;
  }
}

}  // namespace unlidar
