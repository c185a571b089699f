#include "collection/sensor_biases.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdlib>

#include "base/algorithms.hpp"
#include "base/maths.hpp"
#include "scene/stations.hpp"

namespace unlidar {

void RemoveBiases(const std::vector<SensorBias>& biases,
                  std::vector<SensorMeasurement>* measurements) {
  for (SensorMeasurement& one : *measurements) {
    one.measurement.position_m -= biases[one.sensor].bias_m;
    one.measurement.time_ns -= NsOf(biases[one.sensor].delay_s);
  }
}

SensorComparison::SensorComparison(const CollectConfig& config, std::size_t max_differences)
    : prior_(Eigen::Matrix4d::Identity()), max_differences_(max_differences) {
  prior_.topLeftCorner<3, 3>() /= Square(config.sensor_bias_m);
  prior_(3, 3) /= Square(config.sensor_delay_s);
}

void SensorComparison::Add(const std::vector<SensorMeasurement>& measurements, std::size_t first,
                           std::size_t last) {
  for (const SensorMeasurement& one : measurements) {
    if (one.sensor >= sensors_.size()) sensors_.resize(one.sensor + 1);
  }
  for (Sensor& sensor : sensors_) sensor.differences.resize(sensors_.size());
  for (std::size_t i = first; i < last; ++i) {
    Sensor& sensor = sensors_[measurements[i].sensor];
    sensor.station_m = measurements[i].station_m;
    sensor.num_returns += measurements[i].measurement.support;
    for (std::uint32_t other = 0; other < sensors_.size(); ++other) {
      if (other == measurements[i].sensor) continue;
      const std::optional<Difference> difference = DifferenceTo(other, measurements, i);
      if (!difference) continue;
      std::vector<Difference>& kept = sensor.differences[other];
      if (kept.size() == max_differences_) kept.erase(kept.begin());
      kept.push_back(*difference);
    }
  }
}

// Returns the difference of a measurement from those of another sensor, if it has near ones on both
// sides.
std::optional<SensorComparison::Difference> SensorComparison::DifferenceTo(
    std::uint32_t other, const std::vector<SensorMeasurement>& measurements, std::size_t i) {
  const Measurement& m = measurements[i].measurement;
  const TimeNs overlap_ns = NsOf(kSensorOverlapS);
  const auto is_near = [&](std::size_t k) {
    return std::abs(measurements[k].measurement.time_ns - m.time_ns) <= overlap_ns;
  };
  std::size_t before_at = i;
  while (before_at > 0 && is_near(before_at) && measurements[before_at].sensor != other) {
    --before_at;
  }
  std::size_t after_at = i;
  while (after_at + 1 < measurements.size() && is_near(after_at) &&
         measurements[after_at].sensor != other) {
    ++after_at;
  }
  if (measurements[before_at].sensor != other || measurements[after_at].sensor != other) {
    return std::nullopt;
  }
  const Measurement& before = measurements[before_at].measurement;
  const Measurement& after = measurements[after_at].measurement;
  const double pause_s = SecondsOf(after.time_ns - before.time_ns);
  if (pause_s > kSensorOverlapS || pause_s <= 0.0) return std::nullopt;
  const double share = SecondsOf(m.time_ns - before.time_ns) / pause_s;
  const Eigen::Vector3d reference_m = (1.0 - share) * before.position_m + share * after.position_m;
  const double variance_m2 =
      (m.covariance_m2 + (1.0 - share) * before.covariance_m2 + share * after.covariance_m2)
          .trace() /
      3.0;
  Eigen::Matrix<double, 3, 4> design;
  design << Eigen::Matrix3d::Identity(), -measurements[i].velocity_mps;
  return Difference{design.transpose() * design / variance_m2,
                    design.transpose() * (m.position_m - reference_m) / variance_m2};
}

bool SensorComparison::HasDifferences() const {
  return std::any_of(sensors_.begin(), sensors_.end(), [](const Sensor& sensor) {
    return std::any_of(sensor.differences.begin(), sensor.differences.end(),
                       [](const auto& differences) { return !differences.empty(); });
  });
}

std::vector<std::size_t> SensorComparison::Origins() const {
  std::vector<std::uint32_t> by_returns = NumbersBelow(sensors_.size());
  std::stable_sort(by_returns.begin(), by_returns.end(), [&](std::size_t a, std::size_t b) {
    return sensors_[a].num_returns > sensors_[b].num_returns;
  });
  std::vector<std::size_t> origins;
  for (const std::size_t sensor : by_returns) {
    const bool has_origin = std::any_of(origins.begin(), origins.end(), [&](std::size_t origin) {
      const Eigen::Vector3d apart_m = sensors_[origin].station_m - sensors_[sensor].station_m;
      return apart_m.norm() <= kMaxStationRadiusM;
    });
    if (!has_origin && sensors_[sensor].num_returns > 0) origins.push_back(sensor);
  }
  return origins;
}

void SensorComparison::GetBiases(const std::vector<std::size_t>& origins,
                                 std::vector<SensorBias>* biases) const {
  for (std::size_t i = 0; i < biases->size(); ++i) {
    const bool is_added = i < sensors_.size();
    (*biases)[i] = is_added ? BiasFrom(sensors_[i].differences[origins.front()]) : SensorBias();
  }
  Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
  for (const std::size_t origin : origins) sum_m += (*biases)[origin].bias_m;
  const Eigen::Vector3d common_m = sum_m / static_cast<double>(origins.size());
  for (SensorBias& bias : *biases) bias.bias_m -= common_m;
}

// Regularised least squares. Returns the smallest bias among the solutions from all differences and
// from all but one, as that one may contain a stray return.
SensorBias SensorComparison::BiasFrom(const std::vector<Difference>& differences) const {
  Difference all{prior_, Eigen::Vector4d::Zero()};
  for (const Difference& difference : differences) {
    all.information += difference.information;
    all.sum += difference.sum;
  }
  Eigen::Vector4d least = all.information.ldlt().solve(all.sum);
  const auto size = [&](const Eigen::Vector4d& bias) { return bias.dot(prior_ * bias); };
  for (const Difference& one : differences) {
    const Eigen::Matrix4d information = all.information - one.information;
    const Eigen::Vector4d without = information.ldlt().solve(all.sum - one.sum);
    if (size(without) < size(least)) least = without;
  }
  return {least.head<3>(), least[3]};
}

}  // namespace unlidar
