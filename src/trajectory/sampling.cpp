#include "trajectory/sampling.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>

#include "base/maths.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// A time in nanoseconds times a rate in nanohertz has up to 114 bits.
__extension__ using Wide = unsigned __int128;

constexpr double kMaxInstants = 1e7;

// Number of instants of a rate within a time from its begin, without that at its end.
std::size_t CountWithin(Wide elapsed_ns, std::uint64_t nanohertz) {
  constexpr Wide kPerInstant = Wide{kNsPerSecond} * kNsPerSecond;
  return static_cast<std::size_t>((elapsed_ns * nanohertz + kPerInstant - 1) / kPerInstant);
}

constexpr TimeNs kPathStepNs = 20'000'000;  // 50 Hz: finer than any manoeuvre
constexpr TimeNs kMaxPathSteps = 100'000;

// Returns the time for which the target may have been undetected beyond one end: as long as missed
// detections are likelier than `probability`, with the detection rate per frame period of the
// nearest measurements. Their longest pause is excluded: it may be an occlusion.
template <typename Iterator>
TimeNs UndetectedTimeNs(Iterator first, Iterator last, TimeNs period_ns, double probability) {
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
  const double periods = std::floor(std::log(probability) / std::log1p(-seen));
  // Longer than any recording, without overflow when added to a time.
  constexpr TimeNs kForeverNs = 1'000'000'000'000'000'000;
  const bool ends = static_cast<double>(period_ns) * periods < static_cast<double>(kForeverNs);
  return ends ? period_ns * static_cast<TimeNs>(periods) : kForeverNs;
}

// Returns the sigma of a mixture in which the target is `offset_m` away, with another sigma, with
// some probability: that of the Gaussian with the same 99 % interval (method.md (16)). The variance
// of the mixture would mostly express improbable, distant modes.
double MixtureSigma(double probability, double sigma_m, double offset_m, double other_sigma_m) {
  constexpr double kSigmas = 2.575829;
  constexpr double kWithin = 0.99;
  const auto below = [](double x_m, double of_m) {
    return 0.5 * std::erfc(-x_m / of_m * M_SQRT1_2);
  };
  const auto within = [&](double reach_m) {
    return (1.0 - probability) * (2.0 * below(reach_m, sigma_m) - 1.0) +
           probability * (below(reach_m - offset_m, other_sigma_m) -
                          below(-reach_m - offset_m, other_sigma_m));
  };
  if (probability == 0.0 || within(kSigmas * sigma_m) >= kWithin) return sigma_m;
  double low_m = kSigmas * sigma_m;
  double high_m = low_m + std::abs(offset_m) + kSigmas * other_sigma_m;
  constexpr int kHalvings = 50;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle_m = 0.5 * (low_m + high_m);
    (within(middle_m) < kWithin ? low_m : high_m) = middle_m;
  }
  return high_m / kSigmas;
}

// Variances per axis.
Eigen::Vector3d CommonVarianceM2(const CommonErrors& errors, const Eigen::Vector3d& ray_m,
                                 const Eigen::Vector3d& velocity_mps) {
  const Eigen::Matrix3d axes = RayAxes(ray_m);
  return (errors.depth_sigma_m * axes.col(0)).cwiseAbs2() +
         (errors.elevation_sigma_m * axes.col(2)).cwiseAbs2() +
         (errors.time_sigma_s * velocity_mps).cwiseAbs2();
}

}  // namespace

OutputInstants::OutputInstants(const Rate& rate, TimeNs begin_ns, TimeNs end_ns)
    : nanohertz_(static_cast<std::uint64_t>(rate.nanohertz)), begin_ns_(begin_ns) {
  // Unsigned: stamps at both ends of the 64 bits must not overflow.
  const std::uint64_t span_ns =
      static_cast<std::uint64_t>(end_ns) - static_cast<std::uint64_t>(begin_ns);
  const double hertz = static_cast<double>(rate.nanohertz) * kSecondsPerNs;
  const double span_s = static_cast<double>(span_ns) * kSecondsPerNs;
  if (span_s * hertz > kMaxInstants) {
    throw UsageError("--rate " + std::to_string(hertz) + ": a recording of " +
                     std::to_string(span_s) + " s gives over 10 million output times, expected " +
                     "fewer");
  }
  size_ = CountWithin(Wide{span_ns} + 1, nanohertz_);
}

TimeNs OutputInstants::operator[](std::size_t k) const {
  if (nanohertz_ == 0) return list_[k];
  const Wide elapsed_ns = Wide{kNsPerSecond} * kNsPerSecond * k / nanohertz_;
  return static_cast<TimeNs>(static_cast<std::uint64_t>(begin_ns_) +
                             static_cast<std::uint64_t>(elapsed_ns));
}

std::size_t OutputInstants::CountBefore(TimeNs time_ns) const {
  if (nanohertz_ == 0) {
    return static_cast<std::size_t>(std::lower_bound(list_.begin(), list_.end(), time_ns) -
                                    list_.begin());
  }
  if (time_ns <= begin_ns_) return 0;
  return CountWithin(static_cast<std::uint64_t>(time_ns) - static_cast<std::uint64_t>(begin_ns_),
                     nanohertz_);
}

OutputInstants ResolveOutputTimes(const OutputTimes& times, const Recording& recording) {
  if (const auto* const list = std::get_if<std::vector<TimeNs>>(&times)) {
    return OutputInstants(*list);
  }
  std::vector<TimeNs> stamps;
  TimeNs begin_ns = std::numeric_limits<TimeNs>::max();
  TimeNs end_ns = std::numeric_limits<TimeNs>::min();
  for (const FrameInfo& frame : recording.frames) {
    if (frame.sensor == 0) stamps.push_back(frame.stamp_ns);
    begin_ns = std::min(begin_ns, frame.begin_ns);
    end_ns = std::max(end_ns, frame.end_ns);
  }
  const auto* const rate = std::get_if<Rate>(&times);
  if (rate == nullptr) return OutputInstants(std::move(stamps));
  return recording.frames.empty() ? OutputInstants() : OutputInstants(*rate, begin_ns, end_ns);
}

TimeInterval WithUndetected(const TimeInterval& seen, const std::vector<Measurement>& measurements,
                            TimeNs period_ns, double probability) {
  return {seen.begin_ns -
              UndetectedTimeNs(measurements.begin(), measurements.end(), period_ns, probability),
          seen.end_ns +
              UndetectedTimeNs(measurements.rbegin(), measurements.rend(), period_ns, probability)};
}

TimeInterval ExistenceInterval(const Recording& recording,
                               const std::vector<Measurement>& measurements,
                               double min_missed_run_probability) {
  TimeInterval interval{measurements.front().time_ns, measurements.back().time_ns};
  const TimeInterval seen = interval;
  TimeInterval recorded = interval;
  for (const FrameInfo& frame : recording.frames) {
    recorded.begin_ns = std::min(recorded.begin_ns, frame.begin_ns);
    recorded.end_ns = std::max(recorded.end_ns, frame.end_ns);
    if (frame.begin_ns <= seen.begin_ns && seen.begin_ns <= frame.end_ns) {
      interval.begin_ns = std::min(interval.begin_ns, frame.begin_ns);
    }
    if (frame.begin_ns <= seen.end_ns && seen.end_ns <= frame.end_ns) {
      interval.end_ns = std::max(interval.end_ns, frame.end_ns);
    }
  }
  interval = WithUndetected(interval, measurements, ShortestPeriodNs(recording),
                            min_missed_run_probability);
  return {std::max(recorded.begin_ns, interval.begin_ns),
          std::min(recorded.end_ns, interval.end_ns)};
}

std::vector<FrameSupport> SupportByFrame(const Recording& recording,
                                         const std::vector<std::uint32_t>& returns) {
  std::vector<FrameSupport> support;
  std::uint32_t frame_end = 0;
  for (const std::uint32_t index : returns) {
    if (support.empty() || index >= frame_end) {
      // Frames are contiguous in the recording: the first one that ends behind the return.
      const FrameInfo& frame = *FirstFrom(recording.frames, &FrameInfo::last_return, index + 1);
      frame_end = frame.last_return;
      support.push_back({frame.stamp_ns, 0});
    }
    ++support.back().returns;
  }
  return support;
}

std::vector<CovarianceInflation> CovarianceInflationsOf(
    const std::vector<AlternativeMode>& alternative_modes, const Trajectory& trajectory) {
  std::vector<CovarianceInflation> covariance_inflations;
  for (const AlternativeMode& mode : alternative_modes) {
    const TrajectoryRow row = trajectory.At(mode.time_ns);
    Eigen::Vector3d added_m2;
    for (int axis = 0; axis < 3; ++axis) {
      const double sigma_m = MixtureSigma(mode.probability, row.sigma_m[axis],
                                          mode.position_m[axis] - row.position_m[axis],
                                          std::sqrt(mode.variance_m2[axis]));
      added_m2[axis] = Square(sigma_m) - Square(row.sigma_m[axis]);
    }
    if (!covariance_inflations.empty() && covariance_inflations.back().time_ns == mode.time_ns) {
      Eigen::Vector3d& before_m2 = covariance_inflations.back().variance_m2;
      before_m2 = before_m2.cwiseMax(added_m2);
    } else {
      covariance_inflations.push_back({mode.time_ns, added_m2});
    }
  }
  return covariance_inflations;
}

Eigen::Vector3d NearestViewpointM(const std::vector<TimedViewpoint>& viewpoints, TimeNs time_ns) {
  if (viewpoints.empty()) return Eigen::Vector3d::Zero();
  auto at = FirstFrom(viewpoints, &TimedViewpoint::time_ns, time_ns);
  if (at == viewpoints.end() ||
      (at != viewpoints.begin() &&
       std::abs(std::prev(at)->time_ns - time_ns) <= std::abs(at->time_ns - time_ns))) {
    --at;
  }
  return at->viewpoint_m;
}

void SetViewpoints(const std::vector<Measurement>& measurements,
                   std::vector<TimedViewpoint>* viewpoints) {
  viewpoints->clear();
  for (const Measurement& m : measurements) viewpoints->push_back({m.time_ns, m.viewpoint_m});
}

RowSampler::RowSampler(const RowSource& source, const OutputInstants& instants)
    : source_(source),
      instants_(instants),
      instant_(instants.CountBefore(source.presence.begin_ns)),
      support_(source.support.begin()),
      ahead_(Sample()) {}

std::optional<TrajectoryRow> RowSampler::Next() {
  std::optional<TrajectoryRow> row = std::move(ahead_);
  if (!row) return row;
  ahead_ = Sample();
  for (; support_ != source_.support.end(); ++support_) {
    const TimeNs stamp_ns = support_->stamp_ns;
    if (ahead_ && std::abs(ahead_->time_ns - stamp_ns) < std::abs(row->time_ns - stamp_ns)) break;
    row->support += support_->returns;
  }
  return row;
}

// Returns the next row that may be written, without its support.
std::optional<TrajectoryRow> RowSampler::Sample() {
  while (instant_ < instants_.size()) {
    const TimeNs time_ns = instants_[instant_];
    if (time_ns > source_.presence.end_ns) break;
    ++instant_;
    TrajectoryRow row = source_.trajectory.At(time_ns);
    row.track_id = source_.track_id;
    const Eigen::Vector3d ray_m = row.position_m - NearestViewpointM(source_.viewpoints, time_ns);
    row.sigma_m = (row.sigma_m.cwiseAbs2() +
                   CommonVarianceM2(source_.common_errors, ray_m, row.velocity_mps) +
                   VarianceInflationAt(time_ns))
                      .cwiseSqrt();
    if (row.position_m.allFinite() && row.velocity_mps.allFinite() && row.sigma_m.allFinite() &&
        row.sigma_m.maxCoeff() <= source_.max_sigma_m) {
      return row;
    }
  }
  return std::nullopt;
}

// Constant beyond the first and last inflation.
Eigen::Vector3d RowSampler::VarianceInflationAt(TimeNs time_ns) const {
  const std::vector<CovarianceInflation>& all = source_.covariance_inflations;
  if (all.empty()) return Eigen::Vector3d::Zero();
  const auto after = FirstFrom(all, &CovarianceInflation::time_ns, time_ns);
  if (after == all.end()) return all.back().variance_m2;
  if (after == all.begin()) return all.front().variance_m2;
  const CovarianceInflation& before = *std::prev(after);
  const double share = static_cast<double>(time_ns - before.time_ns) /
                       static_cast<double>(after->time_ns - before.time_ns);
  return (1.0 - share) * before.variance_m2 + share * after->variance_m2;
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
