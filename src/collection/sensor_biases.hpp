// Position and time biases between the sensors that see a target.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Longest pause of a sensor across which another one is compared with it: linear interpolation is
// inaccurate over longer ones.
inline constexpr double kSensorOverlapS = 0.3;

// Measurement of a target in one frame of a sensor.
struct SensorMeasurement {
  Measurement measurement;
  std::uint32_t sensor = 0;
  Eigen::Vector3d station_m = Eigen::Vector3d::Zero();     // viewpoint of its station
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();  // expected
};

inline bool IsEarlier(const SensorMeasurement& a, const SensorMeasurement& b) {
  return a.measurement.time_ns < b.measurement.time_ns;
}

// Bias of a sensor relative to the one that sees the target best; extrinsics and clocks are never
// exact.
struct SensorBias {
  Eigen::Vector3d bias_m = Eigen::Vector3d::Zero();
  double delay_s = 0.0;  // of its stamps
};

// Subtracts its bias and delay from each measurement. `biases`: (sensors).
void RemoveBiases(const std::vector<SensorBias>& biases,
                  std::vector<SensorMeasurement>* measurements);

// Compares the sensors that see a target with each other.
class SensorComparison {
 public:
  // Of each pair of sensors the newest `max_differences` are kept.
  explicit SensorComparison(const CollectConfig& config,
                            std::size_t max_differences = std::numeric_limits<std::size_t>::max());

  // Adds the differences between the measurements [first, last) and those of each other sensor,
  // interpolated between the ones just before and after. `measurements`: in order of time.
  void Add(const std::vector<SensorMeasurement>& measurements, std::size_t first, std::size_t last);

  std::size_t num_sensors() const { return sensors_.size(); }
  bool HasDifferences() const;

  // Returns the sensors that the biases are relative to, the main one first: of each station the
  // one with the most returns. Stations are surveyed equally well, and the remaining difference
  // between the sides that they see belongs to none of them.
  std::vector<std::size_t> Origins() const;

  // Sets `biases` (sensors, at least those added), from the differences d of each to the main one:
  // d = bias - velocity * delay. The mean bias of the origins is 0.
  void GetBiases(const std::vector<std::size_t>& origins, std::vector<SensorBias>* biases) const;

 private:
  // Normal equations of (bias, delay) from one difference.
  struct Difference {
    Eigen::Matrix4d information;
    Eigen::Vector4d sum;
  };
  struct Sensor {
    int num_returns = 0;
    Eigen::Vector3d station_m = Eigen::Vector3d::Zero();
    std::vector<std::vector<Difference>> differences;  // (sensors) to each other one
  };

  static std::optional<Difference> DifferenceTo(std::uint32_t other,
                                                const std::vector<SensorMeasurement>& measurements,
                                                std::size_t i);
  SensorBias BiasFrom(const std::vector<Difference>& differences) const;

  Eigen::Matrix4d prior_;
  std::size_t max_differences_;
  std::vector<Sensor> sensors_;
};

}  // namespace unlidar
