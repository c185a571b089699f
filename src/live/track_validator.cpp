#include "live/track_validator.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "base/algorithms.hpp"
#include "collection/suspended.hpp"

namespace unlidar {
namespace {

// A track is judged again after the longer of this interval and this share of its observed time:
// each judgement is a chance for a suspended object to appear to drift.
constexpr double kMinJudgeIntervalS = 0.5;
constexpr double kJudgeIntervalShare = 0.1;
// Drift of a distant static object is tested from three swings on. Without drift until
// kSuspendedAfterS it counts as suspended until it moves away.
constexpr double kSuspendedAfterS = 60.0;
constexpr std::size_t kMaxClouds = 64;

bool MayBeSuspendedFor(const std::vector<Measurement>& measurements, double seen_s) {
  if (!IsStaticFar(measurements) || MovesStraight(measurements)) return false;
  return seen_s < 3.0 * kSwingPeriodS || seen_s > kSuspendedAfterS ||
         !DriftsBeyondNoise(measurements);
}

}  // namespace

TrackValidator::Verdict TrackValidator::Judge(int number, const TrackFollower& follower,
                                              bool is_reported, const RecentPlots& seen,
                                              double time_s, const std::optional<Verdict>& before) {
  const double seen_s = SecondsOf(follower.last_evidence_ns() - follower.first_evidence_ns());
  Verdict verdict;
  verdict.first_judged_age_s = before ? before->first_judged_age_s : seen_s;
  verdict.next_judgement_s =
      time_s +
      std::max(kMinJudgeIntervalS, kJudgeIntervalShare * std::min(seen_s, kSuspendedAfterS));
  SetShape(follower, seen);
  verdict.rejection = ShapeRejection(number, time_s);
  verdict.is_final = verdict.rejection != Rejection::kNone;
  if (verdict.is_final || is_reported) return verdict;
  if (config_.Uses(Rule::kCloud) && shape_.MayBeCloud() &&
      seen_s - verdict.first_judged_age_s < kGrowsWithinS) {
    verdict.rejection = Rejection::kCloud;
  } else if (config_.Uses(Rule::kSuspended) &&
             MayBeSuspendedFor(follower.fit().InlierMeasurements(), seen_s)) {
    verdict.rejection = Rejection::kSuspended;
  }
  return verdict;
}

Rejection TrackValidator::ShapeRejection(int number, double time_s) {
  if (config_.Uses(Rule::kCloud) && IsCloud(number, time_s)) {
    clouds_.push_back({number, time_s, std::exchange(shape_, Shape(config_))});
    return Rejection::kCloud;
  }
  return config_.Uses(Rule::kInsect) && shape_.IsInsect() ? Rejection::kInsect : Rejection::kNone;
}

// True by its own shape and those of recent clouds. Its previous verdict is discarded.
bool TrackValidator::IsCloud(int number, double time_s) {
  EraseIf(&clouds_, [&](const Cloud& cloud) { return cloud.number == number; });
  while (!clouds_.empty() && time_s - clouds_.front().time_s > window_s_) clouds_.pop_front();
  while (clouds_.size() >= kMaxClouds) clouds_.pop_front();
  recent_clouds_.clear();
  for (const Cloud& cloud : clouds_) recent_clouds_.push_back(&cloud.shape);
  return shape_.IsCloud(recent_clouds_);
}

void TrackValidator::SetShape(const TrackFollower& follower, const RecentPlots& seen) {
  const Trajectory& trajectory = follower.fit().trajectory();
  shape_.Clear();
  for (std::size_t end = seen.size(); end > 0;) {
    const Plot& last = seen[end - 1].plot;
    if (last.frame_time_ns < trajectory.begin_ns()) break;
    std::size_t begin = end - 1;
    while (begin > 0 && seen[begin - 1].plot.frame == last.frame) --begin;
    if (last.frame_time_ns <= trajectory.end_ns()) {
      const TrajectoryRow at = trajectory.At(last.frame_time_ns);
      clusters_.clear();
      for (std::size_t i = begin; i < end; ++i) {
        const Plot& plot = seen[i].plot;
        const bool is_own = follower.fit().IsInlier(plot);
        if (!is_own && plot.lowest_m < kPersonHeightM) continue;
        clusters_.push_back(
            {plot.time_ns, plot.position_m, is_own, static_cast<double>(plot.num_returns),
             is_own ? seen[i].ScatterM2(at.velocity_mps) : seen[i].scatter_m2.Full()});
      }
      if (!clusters_.empty()) {
        shape_.Add(at, last.ViewpointM(), StreakM2(last.streak_s, at.velocity_mps), clusters_);
      }
    }
    end = begin;
  }
}

}  // namespace unlidar
