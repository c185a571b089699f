// How the sensors of a target disagree about where and when it was.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/sensor_view.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// A target in one frame of a sensor.
struct Sighting {
  Measurement measurement;
  std::uint32_t sensor;
  Eigen::Vector3d velocity_mps;  // expected
};

// How a sensor disagrees with the one that sees the target best: poses and clocks are never exact.
struct SensorShift {
  Eigen::Vector3d bias_m = Eigen::Vector3d::Zero();
  double delay_s = 0.0;  // its stamps are so much late
};

// The sensor with the most returns (sensors), the first of equal ones.
std::size_t MainSensor(const std::vector<int>& returns);

// The shift of each sensor, `views` (sensors), from the difference d of its measurements to those
// of the main one, just before and after, d = bias - velocity * delay. `sightings`: by time.
std::vector<SensorShift> SensorShifts(const std::vector<Sighting>& sightings,
                                      const std::vector<SensorView>& views,
                                      const CollectConfig& config);

}  // namespace unlidar
