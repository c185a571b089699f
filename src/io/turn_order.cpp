#include "io/turn_order.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "base/angles.hpp"
#include "base/pose_history.hpp"

namespace unlidar {
namespace {

// Returns that are looked at to tell the order: enough that neighbours are less than half a turn
// apart, few enough to cost nothing where the order does not tell.
constexpr std::size_t kSampledReturns = 256;
// The beams of one shot differ in azimuth by up to this; so do the ends of a turn.
constexpr double kShotWidthRad = 10.0 * kRadPerDeg;

// Returns a difference of two azimuths, less than a turn, as one of at most half a turn.
double WrappedRad(double difference_rad) {
  if (difference_rad > M_PI) return difference_rad - 2.0 * M_PI;
  return difference_rad < -M_PI ? difference_rad + 2.0 * M_PI : difference_rad;
}

}  // namespace

bool SetTimesOfTurn(const std::vector<Eigen::Vector3f>& points_m, const SensorConfig& sensor,
                    TimeNs begin_ns, TimeNs end_ns, std::vector<TimeNs>* times_ns) {
  if (points_m.size() < kSampledReturns) return false;
  const Eigen::Matrix3d rotation = RotationOf(sensor.rotation_xyzw).toRotationMatrix();
  const Eigen::Vector3d x_axis = rotation.col(0);
  const Eigen::Vector3d y_axis = rotation.col(1);
  const auto azimuth_of_rad = [&](const Eigen::Vector3f& point_m) {
    const Eigen::Vector3d from_sensor_m = point_m.cast<double>() - sensor.translation_m;
    return ApproximateAtan2(y_axis.dot(from_sensor_m), x_axis.dot(from_sensor_m));
  };
  const std::size_t last = points_m.size() - 1;
  const auto sampled = [&](std::size_t k) { return k * last / (kSampledReturns - 1); };
  std::array<double, kSampledReturns> azimuth_rad;  // of the samples
  std::array<double, kSampledReturns> turned_rad;   // since the first sample
  for (std::size_t k = 0; k < kSampledReturns; ++k) {
    azimuth_rad[k] = azimuth_of_rad(points_m[sampled(k)]);
    turned_rad[k] =
        k == 0 ? 0.0 : turned_rad[k - 1] + WrappedRad(azimuth_rad[k] - azimuth_rad[k - 1]);
  }
  const double turn_rad = turned_rad.back();
  if (std::abs(std::abs(turn_rad) - 2.0 * M_PI) > kShotWidthRad) return false;
  double farthest_rad = 0.0;
  for (const double rad : turned_rad) {
    const double forward_rad = std::copysign(1.0, turn_rad) * rad;
    farthest_rad = std::max(farthest_rad, forward_rad);
    if (farthest_rad - forward_rad > kShotWidthRad) return false;
  }
  const double length_ns = static_cast<double>(end_ns - begin_ns);
  times_ns->resize(points_m.size());
  for (std::size_t k = 0; k < kSampledReturns; ++k) {
    const std::size_t next = k + 1 < kSampledReturns ? sampled(k + 1) : points_m.size();
    for (std::size_t i = sampled(k); i < next; ++i) {
      const double rad = turned_rad[k] + WrappedRad(azimuth_of_rad(points_m[i]) - azimuth_rad[k]);
      const double share = std::clamp(rad / turn_rad, 0.0, 1.0);
      (*times_ns)[i] = begin_ns + static_cast<TimeNs>(share * length_ns);
    }
  }
  return true;
}

}  // namespace unlidar
