#pragma once

namespace unlidar {

// Count that Jeffreys' prior of a Poisson rate is worth.
constexpr double kJeffreysCount = 0.5;

}  // namespace unlidar
