#include "collection/visibility.hpp"

#include <algorithm>

namespace unlidar {
namespace {

double PerM2(const Eigen::Vector3d& ray_m) { return 1.0 / std::max(ray_m.squaredNorm(), 1.0); }

}  // namespace

Visibility::Visibility(const Recording& recording, const std::vector<SensorView>& views,
                       const Trajectory& trajectory, const std::vector<std::uint32_t>& returns)
    : sensors_(views.size()) {
  for (const FrameInfo& frame : recording.frames) {
    const auto first = std::lower_bound(returns.begin(), returns.end(), frame.first_return);
    const auto num_returns =
        static_cast<double>(std::lower_bound(first, returns.end(), frame.last_return) - first);
    const TimeNs time_ns = frame.middle_ns();
    const bool is_within = trajectory.begin_ns() <= time_ns && time_ns <= trajectory.end_ns();
    if (!is_within && num_returns == 0.0) continue;
    const double per_m2 = PerM2(RayM(views[frame.sensor], trajectory.At(time_ns).position_m));
    Sensor& sensor = sensors_[frame.sensor];
    sensor.looks.push_back({time_ns, num_returns, per_m2});
    sensor.num_returns += num_returns;
    sensor.per_m2 += per_m2;
  }
  for (Sensor& sensor : sensors_) {
    std::sort(sensor.looks.begin(), sensor.looks.end(),
              [](const Look& a, const Look& b) { return a.time_ns < b.time_ns; });
  }
}

double Visibility::ReturnsPerFrame(std::uint32_t sensor_index, TimeNs time_ns,
                                   const Eigen::Vector3d& ray_m) const {
  constexpr TimeNs kReachNs = 1'000'000'000;
  constexpr double kJeffreysReturns = 0.5;  // Jeffreys' prior of a Poisson rate
  const Sensor& sensor = sensors_[sensor_index];
  if (sensor.looks.empty()) return kJeffreysReturns;
  double num_returns = kJeffreysReturns;
  double per_m2 = kJeffreysReturns * sensor.per_m2 / (sensor.num_returns + kJeffreysReturns);
  const TimeNs near_ns =
      std::clamp(time_ns, sensor.looks.front().time_ns, sensor.looks.back().time_ns);
  auto look = std::lower_bound(sensor.looks.begin(), sensor.looks.end(), near_ns - kReachNs,
                               [](const Look& at, TimeNs t) { return at.time_ns < t; });
  for (; look != sensor.looks.end() && look->time_ns <= near_ns + kReachNs; ++look) {
    num_returns += look->num_returns;
    per_m2 += look->per_m2;
  }
  return num_returns / per_m2 * PerM2(ray_m);
}

}  // namespace unlidar
