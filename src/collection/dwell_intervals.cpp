#include "collection/dwell_intervals.hpp"

#include <algorithm>
#include <cstddef>

#include "base/maths.hpp"
#include "base/recording.hpp"
#include "trajectory/spline_model.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kStepNs = 250'000'000;
// Far above the rounding of a position and of a knot's time.
constexpr double kSlackM = 1e-6;
constexpr TimeNs kSlackNs = 1000;

// Returns a time for which the target is certain to stay within reach of a place from `at_ns` on,
// in this direction (-1: backward, 1: forward); not above 0 if none is.
TimeNs CertainNs(const Trajectory& trajectory, TimeNs at_ns, int direction,
                 const Eigen::Vector3d& place_m, double reach_m) {
  const auto time_of_knot = [&](std::ptrdiff_t knot) {
    return trajectory.origin_ns + NsOf(trajectory.knots_s[static_cast<std::size_t>(knot)]);
  };
  // Interval i has the control points i to i + 3, and lies between the knots i + 3 and i + 4.
  const std::ptrdiff_t interval =
      IntervalAt(trajectory.knots_s, SecondsOf(at_ns - trajectory.origin_ns));
  const bool is_outside =
      direction < 0 ? at_ns > time_of_knot(interval + 4) : at_ns < time_of_knot(interval + 3);
  if (is_outside) return 0;  // beyond the last interval, or before the first
  const Eigen::Vector3d from_origin_m = place_m - trajectory.origin_m;
  const double squared_reach_m2 = Square(std::max(reach_m - kSlackM, 0.0));
  const auto size = static_cast<std::ptrdiff_t>(trajectory.control_points_m.size());
  std::ptrdiff_t far = direction < 0 ? interval + 3 : interval;  // the first out of reach
  while (
      0 <= far && far < size &&
      (trajectory.control_points_m[static_cast<std::size_t>(far)] - from_origin_m).squaredNorm() <
          squared_reach_m2) {
    far += direction;
  }
  return direction * (time_of_knot(direction < 0 ? far + 4 : far) - at_ns) - kSlackNs;
}

}  // namespace

std::pair<TimeNs, TimeNs> DwellAround(const Trajectory& trajectory, TimeNs time_ns,
                                      const Eigen::Vector3d& place_m, double reach_m) {
  const auto end_of = [&](int direction) {
    const TimeNs last_ns = direction < 0 ? trajectory.begin_ns() : trajectory.end_ns();
    TimeNs at_ns = time_ns;
    while (direction * (last_ns - at_ns) > 0) {
      const TimeNs left_ns = direction * (last_ns - at_ns);
      const TimeNs steps =
          std::clamp<TimeNs>(CertainNs(trajectory, at_ns, direction, place_m, reach_m) / kStepNs, 0,
                             (left_ns + kStepNs - 1) / kStepNs);
      const TimeNs next_ns = at_ns + direction * std::max<TimeNs>(steps, 1) * kStepNs;
      const auto is_near = [&] {
        return (trajectory.At(next_ns).position_m - place_m).norm() < reach_m;
      };
      if (steps == 0 && !is_near()) break;
      at_ns = next_ns;
    }
    return at_ns;
  };
  return {end_of(-1), end_of(1)};
}

}  // namespace unlidar
