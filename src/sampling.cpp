#include "unlidar/sampling.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <limits>

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

// How long the target may have gone unseen beyond one end: as long as a silence is likelier than
// `probability`, if it is seen per frame period as often as in the nearest measurements. The
// longest of their pauses is left out: it may be an occlusion.
template <typename Iterator>
TimeNs Silence(Iterator first, Iterator last, TimeNs period_ns, double probability) {
  constexpr int kMaxSlices = 10;  // frame periods with a measurement
  int num_pauses = 0;
  TimeNs sum = 0;
  TimeNs longest = 0;
  TimeNs before_ns = first->time_ns;
  for (; first != last && num_pauses + 1 < kMaxSlices; ++first) {
    const TimeNs pause = (std::abs(first->time_ns - before_ns) + period_ns / 2) / period_ns;
    if (pause == 0) continue;
    before_ns = first->time_ns;
    ++num_pauses;
    sum += pause;
    longest = std::max(longest, pause);
  }
  if (num_pauses < 2) return 0;
  const double seen = static_cast<double>(num_pauses - 1) / static_cast<double>(sum - longest);
  if (seen >= 1.0) return 0;
  return period_ns * static_cast<TimeNs>(std::log(probability) / std::log1p(-seen));
}

}  // namespace

TimeNs SilenceBeforeNs(const std::vector<Measurement>& measurements, TimeNs period_ns,
                       double probability) {
  return Silence(measurements.begin(), measurements.end(), period_ns, probability);
}

TimeNs SilenceAfterNs(const std::vector<Measurement>& measurements, TimeNs period_ns,
                      double probability) {
  return Silence(measurements.rbegin(), measurements.rend(), period_ns, probability);
}

TimeInterval PresenceInterval(const Recording& recording,
                              const std::vector<Measurement>& measurements,
                              double silence_probability) {
  TimeInterval interval{measurements.front().time_ns, measurements.back().time_ns};
  const TimeInterval seen = interval;
  TimeInterval watched = interval;
  for (const FrameInfo& frame : recording.frames) {
    watched.begin_ns = std::min(watched.begin_ns, frame.begin_ns);
    watched.end_ns = std::max(watched.end_ns, frame.end_ns);
    if (frame.begin_ns <= seen.begin_ns && seen.begin_ns <= frame.end_ns) {
      interval.begin_ns = std::min(interval.begin_ns, frame.begin_ns);
    }
    if (frame.begin_ns <= seen.end_ns && seen.end_ns <= frame.end_ns) {
      interval.end_ns = std::max(interval.end_ns, frame.end_ns);
    }
  }
  const TimeNs period_ns = ShortestPeriodNs(recording);
  const TimeNs before_ns = SilenceBeforeNs(measurements, period_ns, silence_probability);
  const TimeNs after_ns = SilenceAfterNs(measurements, period_ns, silence_probability);
  return {std::max(watched.begin_ns, interval.begin_ns - before_ns),
          std::min(watched.end_ns, interval.end_ns + after_ns)};
}

std::vector<TrajectoryRow> SampleTrajectory(const Trajectory& trajectory,
                                            const TimeInterval& interval,
                                            const std::vector<TimeNs>& times_ns,
                                            double depth_sigma_m, double max_sigma_m) {
  std::vector<TrajectoryRow> rows;
  const auto first = std::lower_bound(times_ns.begin(), times_ns.end(), interval.begin_ns);
  const auto last = std::upper_bound(first, times_ns.end(), interval.end_ns);
  for (auto time_ns = first; time_ns != last; ++time_ns) {
    TrajectoryRow row = trajectory.At(*time_ns);
    const Eigen::Vector3d depth_m = depth_sigma_m * row.position_m.stableNormalized();
    row.sigma_m = (row.sigma_m.cwiseAbs2() + depth_m.cwiseAbs2()).cwiseSqrt();
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
