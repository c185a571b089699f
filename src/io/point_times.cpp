#include "io/point_times.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "base/angles.hpp"
#include "base/pose_history.hpp"
#include "base/recording.hpp"
#include "io/frame_directory.hpp"
#include "io/stamp.hpp"

namespace unlidar {
namespace {

std::optional<TimeNs> InNs(std::int64_t value, std::int64_t unit_ns) {
  if (value > kMaxStampNs / unit_ns || value < -kMaxStampNs / unit_ns) return std::nullopt;
  return value * unit_ns;
}

// Converts whole and fractional parts separately: a product of doubles would round Unix time to 256
// ns.
std::optional<TimeNs> InNs(double value, std::int64_t unit_ns) {
  const double unit = static_cast<double>(unit_ns);
  if (!(std::abs(value) < static_cast<double>(kMaxStampNs) / unit)) return std::nullopt;
  const double whole = std::floor(value);
  return static_cast<std::int64_t>(whole) * unit_ns + std::llround((value - whole) * unit);
}

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

RawTime RawTimeOf(const PcdCloud& cloud, std::size_t row) {
  if (cloud.floating_times.empty()) return cloud.integer_times[row];
  return cloud.floating_times[row];
}

std::optional<TimeNs> PointTime(const RawTime& raw, TimeReading reading, TimeNs stamp_ns) {
  const auto in_ns = [&](auto value) {
    std::int64_t unit_ns = std::is_integral_v<decltype(value)> ? 1 : kNsPerSecond;
    if (reading == TimeReading::kAbsoluteByMagnitude) {
      unit_ns = NsPerUnitByMagnitude(std::abs(static_cast<double>(value)));
    }
    return InNs(value, unit_ns);
  };
  const std::optional<TimeNs> time_ns = std::visit(in_ns, raw);
  if (!time_ns || reading != TimeReading::kOffset) return time_ns;
  return stamp_ns + *time_ns;  // both within kMaxStampNs
}

void TimeReadingVote::Add(const RawTime& raw, TimeNs stamp_ns) {
  std::size_t nearest = 0;
  std::int64_t nearest_ns = std::numeric_limits<std::int64_t>::max();
  for (std::size_t i = 0; i < votes_.size(); ++i) {
    const std::optional<TimeNs> time_ns = PointTime(raw, static_cast<TimeReading>(i), stamp_ns);
    if (!time_ns) continue;
    const std::int64_t distance_ns = std::abs(*time_ns - stamp_ns);
    if (distance_ns >= nearest_ns) continue;
    nearest_ns = distance_ns;
    nearest = i;
  }
  ++votes_[nearest];
}

TimeReading TimeReadingVote::Winner() const {
  const auto most = std::max_element(votes_.begin(), votes_.end());
  return static_cast<TimeReading>(most - votes_.begin());
}

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
