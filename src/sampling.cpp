#include "unlidar/sampling.hpp"

#include <algorithm>
#include <iterator>

namespace unlidar {
namespace {

constexpr TimeNs kPathStepNs = 20'000'000;  // 50 Hz: finer than any drone turns
constexpr TimeNs kMaxPathSteps = 100'000;

// The frame that holds a return.
const FrameInfo& FrameOf(const Recording& recording, std::uint32_t index) {
  // Frames lie one after the other in the recording: it is the first that ends behind the return.
  return *std::upper_bound(
      recording.frames.begin(), recording.frames.end(), index,
      [](std::uint32_t i, const FrameInfo& frame) { return i < frame.last_return; });
}

bool IsFinite(const TrajectoryRow& row) {
  return row.position_m.allFinite() && row.velocity_mps.allFinite() && row.sigma_m.allFinite();
}

// Distance of two times, which cannot overflow.
std::uint64_t Distance(TimeNs a, TimeNs b) {
  return static_cast<std::uint64_t>(std::max(a, b)) - static_cast<std::uint64_t>(std::min(a, b));
}

}  // namespace

TimeInterval EvidenceInterval(const Recording& recording, const Trajectory& trajectory) {
  const TimeInterval fit{trajectory.begin_ns(), trajectory.end_ns()};
  TimeInterval interval = fit;
  for (const FrameInfo& frame : recording.frames) {
    if (frame.begin_ns <= fit.begin_ns && fit.begin_ns <= frame.end_ns) {
      interval.begin_ns = std::min(interval.begin_ns, frame.begin_ns);
    }
    if (frame.begin_ns <= fit.end_ns && fit.end_ns <= frame.end_ns) {
      interval.end_ns = std::max(interval.end_ns, frame.end_ns);
    }
  }
  return interval;
}

std::vector<TrajectoryRow> SampleTrajectory(const Trajectory& trajectory,
                                            const TimeInterval& interval,
                                            const std::vector<TimeNs>& times_ns,
                                            double max_sigma_m) {
  std::vector<TrajectoryRow> rows;
  const auto first = std::lower_bound(times_ns.begin(), times_ns.end(), interval.begin_ns);
  const auto last = std::upper_bound(first, times_ns.end(), interval.end_ns);
  for (auto time_ns = first; time_ns != last; ++time_ns) {
    const TrajectoryRow row = trajectory.At(*time_ns);
    if (IsFinite(row) && row.sigma_m.maxCoeff() <= max_sigma_m) rows.push_back(row);
  }
  return rows;
}

void CountSupport(const Recording& recording, const std::vector<std::uint32_t>& returns,
                  std::vector<TrajectoryRow>& rows) {
  if (rows.empty()) return;
  for (const std::uint32_t index : returns) {
    const TimeNs time_ns = FrameOf(recording, index).stamp_ns;
    auto row =
        std::lower_bound(rows.begin(), rows.end(), time_ns,
                         [](const TrajectoryRow& r, TimeNs time) { return r.time_ns < time; });
    const bool previous_is_nearer =
        row == rows.end() || (row != rows.begin() && Distance(std::prev(row)->time_ns, time_ns) <=
                                                         Distance(row->time_ns, time_ns));
    if (previous_is_nearer) --row;
    ++row->support;
  }
}

double PathLength(const Trajectory& trajectory) {
  const TimeNs span_ns = trajectory.end_ns() - trajectory.begin_ns();
  const TimeNs steps = std::clamp<TimeNs>(span_ns / kPathStepNs, 1, kMaxPathSteps);
  double length_m = 0.0;
  Eigen::Vector3d previous_m = trajectory.At(trajectory.begin_ns()).position_m;
  for (TimeNs step = 1; step <= steps; ++step) {
    const TimeNs elapsed_ns = step == steps ? span_ns : step * (span_ns / steps);
    const Eigen::Vector3d position_m = trajectory.At(trajectory.begin_ns() + elapsed_ns).position_m;
    length_m += (position_m - previous_m).norm();
    previous_m = position_m;
  }
  return length_m;
}

}  // namespace unlidar
