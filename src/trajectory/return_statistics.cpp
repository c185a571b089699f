#include "trajectory/return_statistics.hpp"

#include <algorithm>
#include <cmath>

#include "base/maths.hpp"

namespace unlidar {

ReturnStatistics DescribeReturns(const Recording& recording, const Target& target) {
  const Trajectory& trajectory = target.trajectory;
  ReturnStatistics return_statistics;
  for (const Measurement& m : target.measurements) {
    return_statistics.echo_m2_per_s += m.support * (m.position_m - m.viewpoint_m).squaredNorm();
  }
  return_statistics.echo_m2_per_s /=
      std::max(static_cast<double>(trajectory.duration_ns) * kSecondsPerNs, 1e-3);
  double sum_m2 = 0.0;
  const Eigen::Vector3d viewpoint_m = target.measurements.front().viewpoint_m;
  for (const std::uint32_t i : target.returns) {
    const Eigen::Vector3d centre_m =
        trajectory.At(recording.times_ns[i] + target.time_bias_ns).position_m;
    const Eigen::Vector3d offset_m = recording.points_m[i].cast<double>() - centre_m;
    const Eigen::Vector3d ray = (centre_m - viewpoint_m).stableNormalized();
    sum_m2 += offset_m.squaredNorm() - Square(offset_m.dot(ray));
  }
  if (!target.returns.empty()) {
    return_statistics.extent_m =
        std::sqrt(std::max(0.0, sum_m2) / static_cast<double>(target.returns.size()));
  }
  return return_statistics;
}

}  // namespace unlidar
