#include "live/track_validator.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "collection/suspended.hpp"

namespace unlidar {
namespace {

// A track is judged again after so long, and after so large a share of the time for which it was
// seen: every look is a chance for what hangs to seem to wander.
constexpr double kMinJudgeIntervalS = 0.5;
constexpr double kJudgeIntervalShare = 0.1;
// So much longer one that may be wider than a drone is to be seen: a piece of a cloud grows, or is
// gone by then.
constexpr double kWideObservationS = 3.0;
// What stands still far away is known to wander when it was seen for three swings at least. If it
// did not until this time, it hangs until it goes away.
constexpr double kMinDriftObservationS = 9.0;
constexpr double kSuspendedAfterS = 60.0;
constexpr std::size_t kMaxClouds = 64;

bool MayBeSuspendedFor(const std::vector<Measurement>& measurements, double seen_s) {
  if (!IsStaticFar(measurements) || MovesStraight(measurements)) return false;
  return seen_s < kMinDriftObservationS || seen_s > kSuspendedAfterS ||
         !DriftsBeyondNoise(measurements);
}

}  // namespace

TrackValidator::Verdict TrackValidator::Judge(int number, const TrackFollower& follower,
                                              bool is_reported, const std::vector<LivePlot>& seen,
                                              double time_s, const std::optional<Verdict>& before) {
  const double seen_s =
      static_cast<double>(follower.last_evidence_ns() - follower.first_evidence_ns()) *
      kSecondsPerNs;
  Verdict verdict;
  verdict.first_judged_age_s = before ? before->first_judged_age_s : seen_s;
  verdict.next_judgement_s =
      time_s +
      std::max(kMinJudgeIntervalS, kJudgeIntervalShare * std::min(seen_s, kSuspendedAfterS));
  const bool is_cloud = IsCloud(number, follower, seen, time_s);
  verdict.is_rejected = is_cloud || shape_.IsInsect();
  const bool may_be_cloud =
      shape_.MayBeCloud() && seen_s - verdict.first_judged_age_s < kWideObservationS;
  verdict.is_drone =
      !verdict.is_rejected &&
      (is_reported ||
       (!may_be_cloud && !MayBeSuspendedFor(follower.fit().InlierMeasurements(), seen_s)));
  if (is_cloud) clouds_.push_back({number, time_s, std::exchange(shape_, Shape())});
  return verdict;
}

void TrackValidator::Forget(int number) {
  clouds_.erase(std::remove_if(clouds_.begin(), clouds_.end(),
                               [&](const Cloud& cloud) { return cloud.number == number; }),
                clouds_.end());
}

// By its shape, and those of others lately. What it was judged before is forgotten.
bool TrackValidator::IsCloud(int number, const TrackFollower& follower,
                             const std::vector<LivePlot>& seen, double time_s) {
  Forget(number);
  while (!clouds_.empty() && time_s - clouds_.front().time_s > window_s_) clouds_.pop_front();
  while (clouds_.size() >= kMaxClouds) clouds_.pop_front();
  const Trajectory& trajectory = follower.fit().trajectory();
  shape_.Clear();
  for (auto end = seen.end(); end != seen.begin();) {
    const auto last = std::prev(end);
    if (last->plot.frame_time_ns < trajectory.begin_ns()) break;
    auto begin = last;
    while (begin != seen.begin() && std::prev(begin)->plot.frame == last->plot.frame) --begin;
    if (last->plot.frame_time_ns <= trajectory.end_ns()) {
      clusters_.clear();
      for (auto one = begin; one != end; ++one) {
        const Plot& plot = one->plot;
        const bool is_own = follower.fit().IsInlier(plot);
        if (!is_own && plot.lowest_m < kInTheAirM) continue;
        clusters_.push_back({plot.time_ns, plot.position_m, is_own,
                             static_cast<double>(plot.num_returns), &one->scatter_m2});
      }
      if (!clusters_.empty()) {
        shape_.Add(trajectory.At(last->plot.frame_time_ns),
                   last->plot.position_m - last->plot.ray_m, clusters_);
      }
    }
    end = begin;
  }
  recent_clouds_.clear();
  for (const Cloud& cloud : clouds_) recent_clouds_.push_back(&cloud.shape);
  return shape_.IsCloud(recent_clouds_);
}

}  // namespace unlidar
