// Position and time biases between the sensors that see a target.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/station_model.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Measurement of a target in one frame of a sensor.
struct SensorMeasurement {
  Measurement measurement;
  std::uint32_t sensor;
  Eigen::Vector3d velocity_mps;  // expected
};

// Bias of a sensor relative to the one that sees the target best; extrinsics and clocks are never
// exact.
struct SensorBias {
  Eigen::Vector3d bias_m = Eigen::Vector3d::Zero();
  double delay_s = 0.0;  // of its stamps
};

// Returns the sensor with the most returns (sensors), the first among equals.
std::size_t MainSensor(const std::vector<int>& returns);

// Returns the bias of each sensor (sensors), from the difference d between its measurements and
// those of the main sensor, interpolated between the ones just before and after: d = bias -
// velocity * delay. `sensor_measurements`: in order of time; `station_models`: (sensors).
std::vector<SensorBias> EstimateSensorBiases(
    const std::vector<SensorMeasurement>& sensor_measurements,
    const std::vector<StationModel>& station_models, const CollectConfig& config);

}  // namespace unlidar
