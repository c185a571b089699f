// How long a target stays where it is.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "trajectory/trajectory.hpp"

namespace unlidar {

// The stays of a target at places along its trajectory, which must outlive this. As a spline lies
// in the hull of its control points, what stays near a place for long is found by boxes about
// these, not by walking along it.
class DwellIntervals {
 public:
  explicit DwellIntervals(const Trajectory& trajectory);

  // The interval about `time_ns` in which the target is within `reach_m` of a place: on either side
  // as many steps of 250 ms as are possible, the last one at most beyond the trajectory's end.
  std::pair<TimeNs, TimeNs> Around(TimeNs time_ns, const Eigen::Vector3d& place_m,
                                   double reach_m) const;

 private:
  struct Box {
    Eigen::Vector3d low_m;
    Eigen::Vector3d high_m;
  };

  // How many steps from a time surely stay within reach: 0 if none is sure.
  TimeNs CertainStepsBackward(TimeNs time_ns, const Eigen::Vector3d& place_m, double reach_m) const;
  TimeNs CertainStepsForward(TimeNs time_ns, const Eigen::Vector3d& place_m, double reach_m) const;

  // The last control point up to `last`, and the first from `first` on, that may be out of reach:
  // none between is. -1 and the number of control points if there is none.
  std::ptrdiff_t LastFar(std::ptrdiff_t last, const Eigen::Vector3d& place_m, double reach_m) const;
  std::ptrdiff_t FirstFar(std::ptrdiff_t first, const Eigen::Vector3d& place_m,
                          double reach_m) const;
  bool IsFar(std::size_t level, std::ptrdiff_t box, const Eigen::Vector3d& place_m,
             double reach_m) const;

  int IntervalOf(TimeNs time_ns) const;
  TimeNs TimeOfKnot(std::ptrdiff_t knot) const;

  const Trajectory& trajectory_;
  std::vector<std::vector<Box>> levels_;  // about each control point, about two, four ...
};

}  // namespace unlidar
