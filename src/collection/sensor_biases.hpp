// How the sensors of a target disagree about where and when it was.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/station_model.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// A target in one frame of a sensor.
struct SensorMeasurement {
  Measurement measurement;
  std::uint32_t sensor;
  Eigen::Vector3d velocity_mps;  // expected
};

// How a sensor disagrees with the one that sees the target best: poses and clocks are never exact.
struct SensorBias {
  Eigen::Vector3d bias_m = Eigen::Vector3d::Zero();
  double delay_s = 0.0;  // its stamps are so much late
};

// The sensor with the most returns (sensors), the first of equal ones.
std::size_t MainSensor(const std::vector<int>& returns);

// The sensor_bias of each sensor, `station_models` (sensors), from the difference d of its
// measurements to those of the main one, just before and after, d = bias - velocity * delay.
// `sensor_measurements`: by time.
std::vector<SensorBias> EstimateSensorBiases(
    const std::vector<SensorMeasurement>& sensor_measurements,
    const std::vector<StationModel>& station_models, const CollectConfig& config);

}  // namespace unlidar
