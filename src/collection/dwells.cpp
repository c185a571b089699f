#include "collection/dwells.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <unordered_map>

#include "base/maths.hpp"
#include "base/voxel_grid.hpp"
#include "trajectory/spline_model.hpp"

namespace unlidar {
namespace {

// A dwell lies within this distance of the end of the path.
constexpr float kDwellReachM = 3.0F;
// Gate about its last position from frame to frame.
constexpr float kDwellStepM = 1.0F;
constexpr float kSmoothing = 0.3F;  // weight of a frame in its position
// Close to the ground, low objects hide a target for seconds.
constexpr TimeNs kMaxGapNs = 3'000'000'000;
// Returns with others this close at other times are background, such as the ground.
constexpr float kPlaceM = 0.3F;
constexpr std::size_t kMinFrames = 5;
// Maximum standard deviation of the returns per axis about the position: people are taller, rain is
// scattered.
constexpr float kMaxSpreadM = 0.3F;

// Steps along a trajectory.
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

struct Return {
  std::uint32_t index;
  std::uint32_t frame;
  TimeNs time_ns;  // middle of its frame
};

// One end of a path: direction -1 is its beginning, 1 its end.
class PathEnd {
 public:
  PathEnd(const Recording& recording, const std::vector<char>& taken, const std::vector<Plot>& path,
          int direction)
      : recording_(recording),
        last_(direction < 0 ? path.front() : path.back()),
        place_m_(last_.position_m.cast<float>()) {
    for (std::uint32_t f = 0; f < recording.frames.size(); ++f) {
      const FrameInfo& frame = recording.frames[f];
      const TimeNs time_ns = frame.middle_ns();
      const bool is_beyond = direction * (time_ns - last_.frame_time_ns) > 0;
      if (!is_beyond && !IsTargetAway(path, time_ns)) continue;
      num_away_frames_ += is_beyond ? 0U : 1U;
      for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
        if ((recording.points_m[i] - place_m_).squaredNorm() > kDwellReachM * kDwellReachM) {
          continue;
        }
        if (!is_beyond) {
          away_returns_[VoxelOf(recording.points_m[i], kPlaceM)].push_back(recording.points_m[i]);
        } else if (taken[i] == 0) {
          beyond_.push_back({i, f, time_ns});
        }
      }
    }
    const auto is_later = [&](const Return& a, const Return& b) {
      return direction * (a.time_ns - b.time_ns) < 0;
    };
    std::stable_sort(beyond_.begin(), beyond_.end(), is_later);
  }

  std::vector<Plot> Dwell() const {
    std::vector<Plot> dwell;
    Eigen::Vector3f at_m = place_m_;
    TimeNs time_ns = last_.frame_time_ns;
    Eigen::Array3f square_sum_m2 = Eigen::Array3f::Zero();
    float num_returns = 0.0F;
    for (auto first = beyond_.begin(); first != beyond_.end();) {
      if (std::abs(first->time_ns - time_ns) > kMaxGapNs) break;
      const auto next = std::find_if(first, beyond_.end(),
                                     [&](const Return& one) { return one.frame != first->frame; });
      std::vector<std::uint32_t> returns;
      for (auto one = first; one != next; ++one) {
        if ((PointM(*one) - at_m).norm() > kDwellStepM || IsBackground(*one)) continue;
        returns.push_back(one->index);
        square_sum_m2 += (PointM(*one) - at_m).array().square();
        num_returns += 1.0F;
      }
      if (!returns.empty()) {
        Plot& plot = dwell.emplace_back();
        plot.frame = first->frame;
        plot.sensor = recording_.frames[first->frame].sensor;
        plot.time_ns = plot.frame_time_ns = first->time_ns;
        plot.position_m = MeanOf(recording_, returns);
        plot.num_returns = static_cast<std::uint32_t>(returns.size());
        plot.returns = {returns.begin(), returns.end()};
        at_m += kSmoothing * (dwell.back().position_m.cast<float>() - at_m);
        time_ns = first->time_ns;
      }
      first = next;
    }
    const bool is_wide = (square_sum_m2 > num_returns * kMaxSpreadM * kMaxSpreadM).any();
    if (is_wide || dwell.size() < kMinFrames) return {};
    // The background must have been observed for at least as many frames as the dwell spans.
    const auto [begin, end] = std::minmax(dwell.front().frame, dwell.back().frame);
    if (num_away_frames_ <= end - begin) return {};
    return dwell;
  }

 private:
  Eigen::Vector3f PointM(const Return& one) const { return recording_.points_m[one.index]; }

  // True if the target is known to be away from the place.
  bool IsTargetAway(const std::vector<Plot>& path, TimeNs time_ns) const {
    const auto next = FirstFrom(path, &Plot::frame_time_ns, time_ns);
    const auto is_away = [&](const Plot& plot) {
      return (plot.position_m.cast<float>() - place_m_).norm() > 2.0F * kDwellReachM;
    };
    return next != path.end() && next != path.begin() && is_away(*next) && is_away(*(next - 1));
  }

  bool IsBackground(const Return& one) const {
    const Voxel voxel = VoxelAt(PointM(one), kPlaceM);
    for (int k = 0; k < 27; ++k) {
      const auto cell = away_returns_.find(
          KeyOf({voxel.x + k % 3 - 1, voxel.y + k / 3 % 3 - 1, voxel.z + k / 9 - 1}));
      if (cell == away_returns_.end()) continue;
      for (const Eigen::Vector3f& other_m : cell->second) {
        if ((other_m - PointM(one)).squaredNorm() < kPlaceM * kPlaceM) return true;
      }
    }
    return false;
  }

  const Recording& recording_;
  const Plot& last_;
  Eigen::Vector3f place_m_;
  std::vector<Return> beyond_;  // returns beyond the end of the path, nearest in time first
  // Returns near the place while the target is elsewhere, by voxel, and the number of those frames.
  std::unordered_map<VoxelKey, std::vector<Eigen::Vector3f>> away_returns_;
  std::uint32_t num_away_frames_ = 0;
};

}  // namespace

void AddDwells(const Recording& recording, const std::vector<char>& taken,
               std::vector<Plot>* path) {
  std::vector<Plot> before = PathEnd(recording, taken, *path, -1).Dwell();
  std::vector<Plot> after = PathEnd(recording, taken, *path, 1).Dwell();
  std::move(before.begin(), before.end(), std::back_inserter(*path));
  std::move(after.begin(), after.end(), std::back_inserter(*path));
  SortByFrameTime(path);
}

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
