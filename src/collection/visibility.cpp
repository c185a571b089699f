#include "collection/visibility.hpp"

#include <algorithm>

#include "base/maths.hpp"
#include "scene/plots.hpp"

namespace unlidar {
Visibility::Visibility(const Recording& recording, const std::vector<StationModel>& station_models,
                       const Trajectory& trajectory, const std::vector<std::uint32_t>& returns)
    : sensors_(station_models.size()) {
  for (const FrameInfo& frame : recording.frames) {
    const auto first = std::lower_bound(returns.begin(), returns.end(), frame.first_return);
    const auto num_returns =
        static_cast<double>(std::lower_bound(first, returns.end(), frame.last_return) - first);
    const TimeNs time_ns = frame.middle_ns();
    const bool is_within = trajectory.begin_ns() <= time_ns && time_ns <= trajectory.end_ns();
    if (!is_within && num_returns == 0.0) continue;
    const double per_m2 =
        PerM2(RayM(station_models[frame.sensor], frame, trajectory.At(time_ns).position_m));
    Sensor& sensor = sensors_[frame.sensor];
    sensor.exposures.push_back({time_ns, num_returns, per_m2});
    sensor.num_returns += num_returns;
    sensor.per_m2 += per_m2;
  }
  for (Sensor& sensor : sensors_) {
    std::sort(sensor.exposures.begin(), sensor.exposures.end(), By(&FrameExposure::time_ns));
  }
}

double Visibility::ReturnsPerFrame(std::uint32_t sensor_index, TimeNs time_ns,
                                   const Eigen::Vector3d& ray_m) const {
  constexpr TimeNs kReachNs = 1'000'000'000;
  const Sensor& sensor = sensors_[sensor_index];
  if (sensor.exposures.empty()) return kJeffreysCount;
  double num_returns = kJeffreysCount;
  double per_m2 = kJeffreysCount * sensor.per_m2 / (sensor.num_returns + kJeffreysCount);
  const TimeNs near_ns =
      std::clamp(time_ns, sensor.exposures.front().time_ns, sensor.exposures.back().time_ns);
  auto exposure = FirstFrom(sensor.exposures, &FrameExposure::time_ns, near_ns - kReachNs);
  for (; exposure != sensor.exposures.end() && exposure->time_ns <= near_ns + kReachNs;
       ++exposure) {
    num_returns += exposure->num_returns;
    per_m2 += exposure->per_m2;
  }
  return num_returns / per_m2 * PerM2(ray_m);
}

}  // namespace unlidar
