// Target found by either method, with the trajectory that is written of it.
#pragma once

#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

struct Target {
  std::vector<Measurement> measurements;  // in time order
  std::vector<std::uint32_t> returns;     // indices into the recording, ascending
  double depth_sigma_m = 0.0;             // common error of all measurements, along their rays
  double time_sigma_s = 0.0;              // and of their times, see CommonTimeError
  std::vector<AlternativeMode> alternative_modes;  // in time order
  TimeNs time_bias_ns = 0;  // true minus recorded time of its returns, on average
  double score = 0.0;       // track score (robust) or psi (paper)
  Trajectory trajectory;    // fitted to the measurements once they are final
};

}  // namespace unlidar
