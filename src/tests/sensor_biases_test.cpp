#include "collection/sensor_biases.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "collection/body.hpp"
#include "live/track_fit.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr TimeNs kPeriodNs = 100'000'000;
constexpr double kNoiseM = 0.03;
const Eigen::Vector3d kVelocityMps(1.0, 2.0, 0.5);
const SensorBias kBias{{0.15, -0.1, 0.1}, 0.03};

Eigen::Vector3d DroneM(TimeNs time_ns) {
  return Eigen::Vector3d(5.0, -10.0, 8.0) + SecondsOf(time_ns) * kVelocityMps;
}

// Sensors take turns; sensor 1 has kBias. `supports`: returns of a measurement (sensors).
std::vector<SensorMeasurement> MeasurementsOf(int num_frames, const std::vector<int>& supports,
                                              double station_distance_m = 0.0) {
  Random random(3);
  std::vector<SensorMeasurement> measurements;
  const auto num_sensors = static_cast<int>(supports.size());
  for (int i = 0; i < num_frames * num_sensors; ++i) {
    SensorMeasurement one;
    one.sensor = static_cast<std::uint32_t>(i % num_sensors);
    const SensorBias bias = one.sensor == 1 ? kBias : SensorBias();
    one.measurement.time_ns = i * kPeriodNs / num_sensors;
    one.measurement.position_m = DroneM(one.measurement.time_ns - NsOf(bias.delay_s)) +
                                 bias.bias_m + random.NormalVector(kNoiseM);
    one.measurement.covariance_m2 = kNoiseM * kNoiseM * Eigen::Matrix3d::Identity();
    one.measurement.support = supports[one.sensor];
    one.station_m.x() = station_distance_m * one.sensor;
    one.velocity_mps = kVelocityMps;
    measurements.push_back(one);
  }
  return measurements;
}

// A delay along a straight line is an offset, too: only their sum is observable there.
Eigen::Vector3d OffsetM(const SensorBias& bias) {
  return bias.bias_m - bias.delay_s * kVelocityMps;
}

std::vector<SensorBias> Biases(const SensorComparison& comparison,
                               const std::vector<std::size_t>& origins, std::size_t num_sensors) {
  std::vector<SensorBias> biases(num_sensors);
  comparison.GetBiases(origins, &biases);
  return biases;
}

TEST(SensorComparison, FindsTheBiasRelativeToTheSensorWithTheMostReturns) {
  const std::vector<SensorMeasurement> measurements = MeasurementsOf(100, {5, 2, 1});
  SensorComparison comparison{CollectConfig()};
  comparison.Add(measurements, 0, measurements.size());
  ASSERT_EQ(comparison.Origins(), std::vector<std::size_t>{0});
  const std::vector<SensorBias> biases = Biases(comparison, {0}, 4);
  ASSERT_EQ(biases.size(), 4U);
  for (std::size_t sensor = 0; sensor < 4; ++sensor) {
    const Eigen::Vector3d expected_m = OffsetM(sensor == 1 ? kBias : SensorBias());
    EXPECT_LT((OffsetM(biases[sensor]) - expected_m).norm(), 0.02) << sensor;
  }
  const std::vector<SensorBias> other = Biases(comparison, {1}, 3);
  EXPECT_LT((OffsetM(other[0]) + OffsetM(kBias)).norm(), 0.02);
}

TEST(SensorComparison, SharesABiasBetweenStations) {
  const std::vector<SensorMeasurement> measurements = MeasurementsOf(100, {2, 5}, 30.0);
  SensorComparison comparison{CollectConfig()};
  comparison.Add(measurements, 0, measurements.size());
  ASSERT_EQ(comparison.Origins(), (std::vector<std::size_t>{1, 0}));
  const std::vector<SensorBias> biases = Biases(comparison, comparison.Origins(), 2);
  EXPECT_LT((biases[0].bias_m + biases[1].bias_m).norm(), 1e-9);
}

TEST(SensorComparison, PartsOfAFlightAddUpToTheWhole) {
  const std::vector<SensorMeasurement> measurements = MeasurementsOf(100, {5, 2});
  SensorComparison whole{CollectConfig()};
  whole.Add(measurements, 0, measurements.size());
  SensorComparison parts{CollectConfig()};
  for (std::size_t first = 0; first < measurements.size(); first += 8) {
    parts.Add(measurements, first, first + 8);
  }
  EXPECT_EQ(parts.Origins(), whole.Origins());
  EXPECT_EQ(Biases(parts, {0}, 2)[1].bias_m, Biases(whole, {0}, 2)[1].bias_m);
}

TEST(SensorComparison, OneStrayDoesNotShift) {
  std::vector<SensorMeasurement> measurements = MeasurementsOf(20, {5, 2, 1});
  measurements[32].measurement.position_m.z() += 3.0;
  ASSERT_EQ(measurements[32].sensor, 2U);
  SensorComparison comparison{CollectConfig()};
  comparison.Add(measurements, 0, measurements.size());
  EXPECT_LT(OffsetM(Biases(comparison, {0}, 3)[2]).norm(), 0.03);
}

TEST(SensorComparison, OnlyTheNewestDifferencesCount) {
  std::vector<SensorMeasurement> measurements = MeasurementsOf(100, {5, 2});
  for (std::size_t i = 0; i < 100; ++i) {
    measurements[i].measurement.position_m.z() += i % 2 == 0 ? 0.0 : 1.0;
  }
  SensorComparison comparison(CollectConfig(), 20);
  comparison.Add(measurements, 0, measurements.size());
  EXPECT_LT((OffsetM(Biases(comparison, {0}, 2)[1]) - OffsetM(kBias)).norm(), 0.03);
}

TEST(SensorComparison, SensorsThatSeeItOneAfterTheOtherAreNotCompared) {
  std::vector<SensorMeasurement> measurements = MeasurementsOf(40, {5, 2});
  for (std::size_t i = 0; i < measurements.size(); ++i) measurements[i].sensor = i < 40 ? 0 : 1;
  SensorComparison comparison{CollectConfig()};
  comparison.Add(measurements, 0, measurements.size());
  EXPECT_FALSE(comparison.HasDifferences());
  EXPECT_EQ(Biases(comparison, {0}, 2)[1].bias_m, Eigen::Vector3d::Zero());
}

// Of a stream: the first sensor is the origin as long as the track lasts, although the other one
// has the most returns soon, and alone sees it in the end.
TEST(SensorBiases, AStreamKeepsTheOriginOfATrack) {
  const CollectConfig config;
  TrajectoryFitter fitter{TrajectoryConfig()};
  TrackFit fit(config);
  const std::vector<SensorMeasurement> measurements = MeasurementsOf(300, {3, 2});
  const auto is_seen = [&](std::size_t i) { return measurements[i].sensor == 1 || i < 200; };
  for (std::size_t newest = 20; newest < measurements.size(); newest += 2) {
    fit.Clear();
    const TimeNs now_ns = measurements[newest].measurement.time_ns;
    for (std::size_t i = newest + 1; i-- > 0;) {
      const Measurement& m = measurements[i].measurement;
      if (!is_seen(i) || m.time_ns < now_ns - NsOf(6.0)) continue;
      LivePlot seen;
      seen.plot.time_ns = m.time_ns;
      seen.plot.position_m = seen.plot.ray_m = m.position_m;
      seen.plot.sensor = measurements[i].sensor;
      seen.plot.frame = static_cast<std::uint32_t>(i);
      seen.plot.num_returns =
          static_cast<std::uint32_t>(m.support) * (i >= 60 && i % 2 == 1 ? 2U : 1U);
      fit.AddEarlier(seen, kVelocityMps, 0.05, config.centroid_offset);
    }
    fit.Fit(now_ns - NsOf(1.0), fitter);
    if (newest < 40) continue;
    const TimeNs time_ns = now_ns - NsOf(0.5);
    const Eigen::Vector3d body_m = FacingSideOffsetM(0.05, DroneM(time_ns), config.centroid_offset);
    const Eigen::Vector3d error_m =
        fit.trajectory().At(time_ns).position_m - (DroneM(time_ns) + body_m);
    EXPECT_LT(error_m.norm(), 0.06) << newest;
  }
}

}  // namespace
}  // namespace unlidar
