// Expected number of returns of a target.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/station_model.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

// Expected returns of a target per frame of a sensor, which fall with the square of range.
// Estimated from the frames near the time, with the mean of the whole flight as the prior.
class Visibility {
 public:
  // `station_models`: (sensors). `returns`: the target's, ascending.
  Visibility(const Recording& recording, const std::vector<StationModel>& station_models,
             const Trajectory& trajectory, const std::vector<std::uint32_t>& returns);

  // Returns the expected returns per frame, constant beyond the ends of the trajectory but for
  // range.
  double ReturnsPerFrame(std::uint32_t sensor_index, TimeNs time_ns,
                         const Eigen::Vector3d& ray_m) const;

 private:
  struct FrameExposure {
    TimeNs time_ns;
    double num_returns;
    double per_m2;
  };
  struct Sensor {
    std::vector<FrameExposure> exposures;  // in order of time
    double num_returns = 0.0;
    double per_m2 = 0.0;
  };

  std::vector<Sensor> sensors_;
};

}  // namespace unlidar
