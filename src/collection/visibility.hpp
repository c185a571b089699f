// How often a target is seen.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/station_model.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

// How often a sensor sees a target: returns expected in a frame, which fall with the square of
// range. Some time tells more of it than the whole flight does, which it leans on.
class Visibility {
 public:
  // `station_models`: (sensors). `returns`: the target's, ascending.
  Visibility(const Recording& recording, const std::vector<StationModel>& station_models,
             const Trajectory& trajectory, const std::vector<std::uint32_t>& returns);

  // Beyond its ends as often as there.
  double ReturnsPerFrame(std::uint32_t sensor_index, TimeNs time_ns,
                         const Eigen::Vector3d& ray_m) const;

 private:
  struct FrameExposure {
    TimeNs time_ns;
    double num_returns;
    double per_m2;
  };
  struct Sensor {
    std::vector<FrameExposure> exposures;  // by time
    double num_returns = 0.0;
    double per_m2 = 0.0;
  };

  std::vector<Sensor> sensors_;
};

}  // namespace unlidar
