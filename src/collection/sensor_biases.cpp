#include "collection/sensor_biases.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace unlidar {
namespace {

// Longest pause of the main sensor across which another one is compared with it: linear
// interpolation is inaccurate over longer ones.
constexpr double kSensorOverlapS = 0.3;

// Stations are surveyed equally well, and the remaining difference between the sides that they see
// belongs to none of them: the origin is the mean over stations of the bias of each station's
// sensor with the most returns. With one station this is its main sensor.
Eigen::Vector3d CommonBiasM(const std::vector<SensorBias>& sensor_biases,
                            const std::vector<int>& returns,
                            const std::vector<StationModel>& station_models) {
  Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
  double num_stations = 0.0;
  for (std::size_t sensor = 0; sensor < sensor_biases.size(); ++sensor) {
    if (returns[sensor] == 0) continue;
    std::vector<int> of_station = returns;
    for (std::size_t other = 0; other < sensor_biases.size(); ++other) {
      if (station_models[other].viewpoint_m != station_models[sensor].viewpoint_m)
        of_station[other] = 0;
    }
    if (MainSensor(of_station) != sensor) continue;
    sum_m += sensor_biases[sensor].bias_m;
    num_stations += 1.0;
  }
  return sum_m / num_stations;
}

// Normal equations of (bias, delay) from comparisons of a sensor with the main one.
struct Comparison {
  Eigen::Matrix4d information;
  Eigen::Vector4d sum;
};

// Regularised least squares. Returns the smallest bias among the solutions from all comparisons and
// from all but one, as that one may contain a stray return.
Eigen::Vector4d SensorBiasOf(const std::vector<Comparison>& comparisons,
                             const Eigen::Matrix4d& prior) {
  Comparison all{prior, Eigen::Vector4d::Zero()};
  for (const Comparison& comparison : comparisons) {
    all.information += comparison.information;
    all.sum += comparison.sum;
  }
  Eigen::Vector4d least = all.information.ldlt().solve(all.sum);
  const auto size = [&](const Eigen::Vector4d& sensor_bias) {
    return sensor_bias.dot(prior * sensor_bias);
  };
  for (const Comparison& one : comparisons) {
    const Eigen::Matrix4d information = all.information - one.information;
    const Eigen::Vector4d without = information.ldlt().solve(all.sum - one.sum);
    if (size(without) < size(least)) least = without;
  }
  return least;
}

}  // namespace

std::size_t MainSensor(const std::vector<int>& returns) {
  return static_cast<std::size_t>(std::max_element(returns.begin(), returns.end()) -
                                  returns.begin());
}

std::vector<SensorBias> EstimateSensorBiases(
    const std::vector<SensorMeasurement>& sensor_measurements,
    const std::vector<StationModel>& station_models, const CollectConfig& config) {
  const std::size_t num_sensors = station_models.size();
  std::vector<int> returns(num_sensors, 0);
  for (const SensorMeasurement& sensor_measurement : sensor_measurements)
    returns[sensor_measurement.sensor] += sensor_measurement.measurement.support;
  const std::size_t main_sensor = MainSensor(returns);
  Eigen::Matrix4d prior = Eigen::Matrix4d::Identity();
  prior.topLeftCorner<3, 3>() /= config.sensor_bias_m * config.sensor_bias_m;
  prior(3, 3) /= config.sensor_delay_s * config.sensor_delay_s;
  std::vector<std::vector<Comparison>> comparisons(num_sensors);
  const Measurement* before = nullptr;
  for (std::size_t i = 0; i < sensor_measurements.size(); ++i) {
    const Measurement& m = sensor_measurements[i].measurement;
    if (sensor_measurements[i].sensor == main_sensor) {
      before = &m;
      continue;
    }
    std::size_t k = i;
    while (k < sensor_measurements.size() && sensor_measurements[k].sensor != main_sensor) ++k;
    if (before == nullptr || k == sensor_measurements.size()) continue;
    const Measurement& after = sensor_measurements[k].measurement;
    const double pause_s = SecondsOf(after.time_ns - before->time_ns);
    if (pause_s > kSensorOverlapS || pause_s <= 0.0) continue;
    const double share = SecondsOf(m.time_ns - before->time_ns) / pause_s;
    const Eigen::Vector3d reference = (1.0 - share) * before->position_m + share * after.position_m;
    const double variance =
        (m.covariance_m2 + (1.0 - share) * before->covariance_m2 + share * after.covariance_m2)
            .trace() /
        3.0;
    Eigen::Matrix<double, 3, 4> design;
    design << Eigen::Matrix3d::Identity(), -sensor_measurements[i].velocity_mps;
    comparisons[sensor_measurements[i].sensor].push_back(
        {design.transpose() * design / variance,
         design.transpose() * (m.position_m - reference) / variance});
  }
  std::vector<SensorBias> sensor_biases;
  for (std::size_t sensor = 0; sensor < num_sensors; ++sensor) {
    const Eigen::Vector4d sensor_bias = SensorBiasOf(comparisons[sensor], prior);
    sensor_biases.push_back({sensor_bias.head<3>(), sensor_bias[3]});
  }
  const Eigen::Vector3d common_m = CommonBiasM(sensor_biases, returns, station_models);
  for (SensorBias& sensor_bias : sensor_biases) sensor_bias.bias_m -= common_m;
  return sensor_biases;
}

}  // namespace unlidar
