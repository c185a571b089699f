// Time intervals in which a target stays near a place.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "trajectory/trajectory.hpp"

namespace unlidar {

// Dwells of a target at places along its trajectory, which must outlive this object. A spline lies
// in the convex hull of its control points, so long dwells are found by bounding boxes of these
// instead of sampling.
class DwellIntervals {
 public:
  explicit DwellIntervals(const Trajectory& trajectory);

  // Returns the interval about `time_ns` in which the target is within `reach_m` of a place,
  // extended to either side in steps of 250 ms; the last step may pass the end of the trajectory.
  std::pair<TimeNs, TimeNs> Around(TimeNs time_ns, const Eigen::Vector3d& place_m,
                                   double reach_m) const;

 private:
  struct Box {
    Eigen::Vector3d low_m;
    Eigen::Vector3d high_m;
  };

  // Number of steps from a time that are certain to stay within reach; 0 if none is.
  TimeNs CertainStepsBackward(TimeNs time_ns, const Eigen::Vector3d& place_m, double reach_m) const;
  TimeNs CertainStepsForward(TimeNs time_ns, const Eigen::Vector3d& place_m, double reach_m) const;

  // The last control point up to `last`, or the first from `first` on, that may be out of reach;
  // none in between is. -1 or the number of control points if there is none.
  std::ptrdiff_t LastFar(std::ptrdiff_t last, const Eigen::Vector3d& place_m, double reach_m) const;
  std::ptrdiff_t FirstFar(std::ptrdiff_t first, const Eigen::Vector3d& place_m,
                          double reach_m) const;
  bool IsFar(std::size_t level, std::ptrdiff_t box, const Eigen::Vector3d& place_m,
             double reach_m) const;

  int IntervalOf(TimeNs time_ns) const;
  TimeNs TimeOfKnot(std::ptrdiff_t knot) const;

  const Trajectory& trajectory_;
  std::vector<std::vector<Box>> levels_;  // boxes of 1, 2, 4 ... control points
};

}  // namespace unlidar
