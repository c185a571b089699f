#include "collection/dwell_intervals.hpp"

#include <algorithm>

#include "base/recording.hpp"
#include "trajectory/bspline.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kStepNs = 250'000'000;
// Far above the rounding of a position and of a knot's time.
constexpr double kSlackM = 1e-6;
constexpr TimeNs kSlackNs = 1000;

}  // namespace

DwellIntervals::DwellIntervals(const Trajectory& trajectory) : trajectory_(trajectory), levels_(1) {
  for (const Eigen::Vector3d& point_m : trajectory.control_points_m) {
    const Eigen::Vector3d at_m = trajectory.origin_m + point_m;
    levels_[0].push_back({at_m, at_m});
  }
  while (levels_.back().size() > 1) {
    const std::vector<Box>& below = levels_.back();
    std::vector<Box> boxes;
    for (std::size_t i = 0; i < below.size(); i += 2) {
      const Box& other = below[std::min(i + 1, below.size() - 1)];
      boxes.push_back(
          {below[i].low_m.cwiseMin(other.low_m), below[i].high_m.cwiseMax(other.high_m)});
    }
    levels_.push_back(std::move(boxes));
  }
}

std::pair<TimeNs, TimeNs> DwellIntervals::Around(TimeNs time_ns, const Eigen::Vector3d& place_m,
                                                 double reach_m) const {
  const auto is_near = [&](TimeNs at_ns) {
    return (trajectory_.At(at_ns).position_m - place_m).norm() < reach_m;
  };
  TimeNs from = time_ns;
  while (from > trajectory_.begin_ns()) {
    const TimeNs steps = CertainStepsBackward(from, place_m, reach_m);
    if (steps == 0 && !is_near(from - kStepNs)) break;
    from -= std::max<TimeNs>(steps, 1) * kStepNs;
  }
  TimeNs to = time_ns;
  while (to < trajectory_.end_ns()) {
    const TimeNs steps = CertainStepsForward(to, place_m, reach_m);
    if (steps == 0 && !is_near(to + kStepNs)) break;
    to += std::max<TimeNs>(steps, 1) * kStepNs;
  }
  return {from, to};
}

TimeNs DwellIntervals::CertainStepsBackward(TimeNs time_ns, const Eigen::Vector3d& place_m,
                                            double reach_m) const {
  const int interval = IntervalOf(time_ns);
  if (time_ns > TimeOfKnot(interval + 4)) return 0;  // beyond the last interval
  // Interval i has the control points i to i + 3 and begins at knot i + 3.
  const std::ptrdiff_t first = LastFar(interval + 3, place_m, reach_m) + 1;
  if (first > interval) return 0;
  const TimeNs sure_ns = time_ns - (TimeOfKnot(first + 3) + kSlackNs);
  const TimeNs left_ns = time_ns - trajectory_.begin_ns();
  return std::clamp<TimeNs>(sure_ns / kStepNs, 0, (left_ns + kStepNs - 1) / kStepNs);
}

TimeNs DwellIntervals::CertainStepsForward(TimeNs time_ns, const Eigen::Vector3d& place_m,
                                           double reach_m) const {
  const int interval = IntervalOf(time_ns);
  if (time_ns < TimeOfKnot(interval + 3)) return 0;  // before the first interval
  const std::ptrdiff_t last = FirstFar(interval, place_m, reach_m) - 4;
  if (last < interval) return 0;
  const TimeNs sure_ns = TimeOfKnot(last + 4) - kSlackNs - time_ns;
  const TimeNs left_ns = trajectory_.end_ns() - time_ns;
  return std::clamp<TimeNs>(sure_ns / kStepNs, 0, (left_ns + kStepNs - 1) / kStepNs);
}

// Ascends through the boxes that end at the control point, each twice the size of the one before,
// while they are near; then descends into the first that is not. A box may be far, at a corner,
// although neither half is: then the half that is tested last is taken as far.
std::ptrdiff_t DwellIntervals::LastFar(std::ptrdiff_t last, const Eigen::Vector3d& place_m,
                                       double reach_m) const {
  std::size_t level = 0;
  std::ptrdiff_t box = last;
  while (!IsFar(level, box, place_m, reach_m)) {
    while (box % 2 == 0) {
      if (box == 0) return -1;
      box /= 2;
      ++level;
    }
    --box;
  }
  for (; level > 0; --level) {
    box = std::min<std::ptrdiff_t>(2 * box + 1,
                                   static_cast<std::ptrdiff_t>(levels_[level - 1].size()) - 1);
    if (!IsFar(level - 1, box, place_m, reach_m)) --box;
  }
  return box;
}

std::ptrdiff_t DwellIntervals::FirstFar(std::ptrdiff_t first, const Eigen::Vector3d& place_m,
                                        double reach_m) const {
  std::size_t level = 0;
  std::ptrdiff_t box = first;
  while (!IsFar(level, box, place_m, reach_m)) {
    ++box;
    while (box % 2 == 0 && level + 1 < levels_.size()) {
      box /= 2;
      ++level;
    }
    if (box >= static_cast<std::ptrdiff_t>(levels_[level].size())) {
      return static_cast<std::ptrdiff_t>(levels_[0].size());
    }
  }
  for (; level > 0; --level) {
    box *= 2;
    const auto last = static_cast<std::ptrdiff_t>(levels_[level - 1].size()) - 1;
    if (box < last && !IsFar(level - 1, box, place_m, reach_m)) ++box;
  }
  return box;
}

bool DwellIntervals::IsFar(std::size_t level, std::ptrdiff_t box, const Eigen::Vector3d& place_m,
                           double reach_m) const {
  const Box& at = levels_[level][static_cast<std::size_t>(box)];
  const Eigen::Vector3d farthest_m =
      (place_m - at.low_m).cwiseAbs().cwiseMax((at.high_m - place_m).cwiseAbs());
  return farthest_m.norm() >= reach_m - kSlackM;
}

int DwellIntervals::IntervalOf(TimeNs time_ns) const {
  return IntervalAt(trajectory_.knots_s,
                    static_cast<double>(time_ns - trajectory_.origin_ns) * kSecondsPerNs);
}

TimeNs DwellIntervals::TimeOfKnot(std::ptrdiff_t knot) const {
  return trajectory_.origin_ns + NsOf(trajectory_.knots_s[static_cast<std::size_t>(knot)]);
}

}  // namespace unlidar
