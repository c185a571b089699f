#include "trajectory/echo.hpp"

#include <algorithm>
#include <cmath>

#include "base/square.hpp"

namespace unlidar {

EchoCharacter DescribeEcho(const Recording& recording, const Target& target,
                           const Trajectory& trajectory) {
  EchoCharacter echo;
  for (const Measurement& m : target.measurements) {
    echo.echo_m2_per_s += m.support * (m.position_m - m.viewpoint_m).squaredNorm();
  }
  echo.echo_m2_per_s /= std::max(static_cast<double>(trajectory.duration_ns) * kSecondsPerNs, 1e-3);
  double sum_m2 = 0.0;
  const Eigen::Vector3d viewpoint_m = target.measurements.front().viewpoint_m;
  for (const std::uint32_t i : target.returns) {
    const Eigen::Vector3d centre_m =
        trajectory.At(recording.times_ns[i] + target.late_ns).position_m;
    const Eigen::Vector3d off_m = recording.points_m[i].cast<double>() - centre_m;
    const Eigen::Vector3d ray = (centre_m - viewpoint_m).stableNormalized();
    sum_m2 += off_m.squaredNorm() - Square(off_m.dot(ray));
  }
  if (!target.returns.empty()) {
    echo.extent_m = std::sqrt(std::max(0.0, sum_m2) / static_cast<double>(target.returns.size()));
  }
  return echo;
}

}  // namespace unlidar
