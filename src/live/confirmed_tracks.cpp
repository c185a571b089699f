#include "live/confirmed_tracks.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "trajectory/sampling.hpp"

namespace unlidar {
namespace {

// Rows beyond the evidence are extrapolated. They are emitted while their sigma is at most this
// share of trajectory.max_sigma_m; otherwise they wait for the next plot or the end of the stream.
constexpr double kExtrapolatedSigmaShare = 0.25;
// A track not yet accepted as a drone keeps rows of this length at most: a suspended object may
// stay for days.
constexpr double kMaxUnreportedS = 20.0;
constexpr double kMinClaimGain = 0.0;  // a plot above this gain is assigned to a track
constexpr double kNearM = 1.5;         // reach within which a return belongs to a target

bool AreNear(const Eigen::Vector3d& target_m, const Eigen::Vector3d& place_m) {
  return (target_m - place_m).norm() < kNearM;
}

}  // namespace

ConfirmedTracks::ConfirmedTracks(const Config& config, const std::vector<TrackModel>& models,
                                 OutputTimes output_times, EngineCallback on_event,
                                 LiveTrace& trace)
    : config_(config),
      models_(models),
      instants_(std::move(output_times), NsOf(config.live.silent_s)),
      fitter_(config.trajectory),
      validator_(config.robust, config.live.window_s),
      on_event_(std::move(on_event)),
      trace_(trace) {}

// Returns of a place since the track arrived there are not clutter to that track.
void ConfirmedTracks::SetAdaptedPlots(const std::vector<LivePlot>& plots, Track* track) {
  track->adapted_plots.assign(plots.begin(), plots.end());
  for (LivePlot& seen : track->adapted_plots) {
    if (std::isnan(seen.dwell_begin_s) ||
        !AreNear(track->follower->PlaceAtM(seen.dwell_begin_s), seen.plot.position_m))
      continue;
    const double log_before =
        std::max(seen.log_surrounding_clutter, std::log(seen.plot.place_rate));
    seen.plot.log_clutter = std::min(seen.plot.log_clutter, log_before);
  }
}

const std::vector<char>& ConfirmedTracks::Extend(const std::vector<LivePlot>& plots,
                                                 const FrameTime& at,
                                                 const std::vector<double>& ground_gains) {
  claims_.assign(plots.size(), Claim());
  // A plot of a ground target is no sighting of a track that has been lost.
  const auto is_of_ground_target = [&](std::size_t plot, const TrackFollower& lost, double gain) {
    return !ground_gains.empty() && ground_gains[plot] > std::max(gain, kMinClaimGain) &&
           lost.IsLost(at.time_s);
  };
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    const TrackFollower& follower = *tracks_[t].follower;
    SetAdaptedPlots(plots, &tracks_[t]);
    follower.SetGains(tracks_[t].adapted_plots, at, &gains_);
    for (std::size_t i = 0; i < plots.size(); ++i) {
      if (gains_[i] > claims_[i].gain && !is_of_ground_target(i, follower, gains_[i])) {
        claims_[i] = {gains_[i], t};
      }
    }
  }
  are_free_.clear();
  for (const Claim& claim : claims_) are_free_.push_back(claim.gain <= kMinClaimGain ? 1 : 0);
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    are_allowed_ = are_free_;
    for (std::size_t i = 0; i < plots.size(); ++i) {
      if (is_of_ground_target(i, *tracks_[t].follower, kMinClaimGain)) are_allowed_[i] = 0;
      if (claims_[i].track == t) are_allowed_[i] = 1;
    }
    tracks_[t].follower->Extend(tracks_[t].adapted_plots, are_allowed_, at);
    tracks_[t].is_new = false;
  }
  return are_free_;
}

bool ConfirmedTracks::HasLost(double time_s) const {
  return std::any_of(tracks_.begin(), tracks_.end(),
                     [&](const Track& track) { return track.follower->IsLost(time_s); });
}

std::optional<int> ConfirmedTracks::TrackOf(std::size_t plot) const {
  const Claim& claim = claims_[plot];
  if (claim.gain <= kMinClaimGain) return std::nullopt;
  return tracks_[claim.track].number;
}

KnownTargets ConfirmedTracks::TargetsAt(double time_s) {
  KnownTargets targets;
  const Eigen::Vector3d near_m = Eigen::Vector3d::Constant(kNearM);
  for (Track& track : tracks_) {
    track.place_m = track.follower->PlaceAtM(time_s);
    targets.box_m.extend(track.place_m - near_m).extend(track.place_m + near_m);
  }
  targets.are_at = [this](const Eigen::Vector3d& place_m, double dwell_begin_s) {
    return std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
      return AreNear(track.place_m, place_m) &&
             AreNear(track.follower->PlaceAtM(dwell_begin_s), place_m);
    });
  };
  return targets;
}

bool ConfirmedTracks::HasTrackOf(const Flight& flight) const {
  return std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
    const auto near =
        std::count_if(flight.plots.begin(), flight.plots.end(), [&](const LivePlot& seen) {
          return AreNear(track.follower->PlaceAtM(seen.time_s), seen.plot.position_m);
        });
    return 2 * static_cast<std::size_t>(near) >= flight.plots.size();
  });
}

int ConfirmedTracks::Initiate(const Flight& flight) {
  Track& track = tracks_.emplace_back();
  track.follower = std::make_unique<TrackFollower>(flight, models_, config_.robust);
  track.number = next_number_++;
  Trace(track, TrackState::kInitiated, Rejection::kNone);
  return track.number;
}

void ConfirmedTracks::Judge(const RecentPlots& seen, double time_s, bool may_wait) {
  for (auto track = tracks_.begin(); track != tracks_.end();) {
    TrackFollower& follower = *track->follower;
    const bool is_due =
        track->verdict ? time_s >= track->verdict->next_judgement_s : !(may_wait && track->is_new);
    if (is_due) {
      if (!track->is_reported) follower.Fit(fitter_);
      const std::optional<TrackValidator::Verdict> before = track->verdict;
      track->verdict = validator_.Judge(track->number, follower, track->is_reported, seen, time_s,
                                        track->verdict);
      const TrackValidator::Verdict& now = *track->verdict;
      const bool is_known =
          before && before->rejection == now.rejection && before->is_final == now.is_final;
      if (now.rejection != Rejection::kNone && !is_known) {
        Trace(*track, now.is_final ? TrackState::kRejected : TrackState::kWaiting, now.rejection);
      }
    }
    if (track->is_reported && track->verdict->is_final) {
      ReportEnd(*track);
      track = tracks_.erase(track);
    } else {
      ++track;
    }
  }
}

const std::vector<LivePlot>& ConfirmedTracks::EmitRows(TimeNs searched_ns, TimeNs newest_ns) {
  const TimeNs due_ns = newest_ns - NsOf(config_.live.delay_s);
  settled_.clear();
  for (Track& track : tracks_) {
    EmitRowsOf(&track, std::min(due_ns, searched_ns), newest_ns, kExtrapolatedSigmaShare);
  }
  return settled_;
}

const std::vector<LivePlot>& ConfirmedTracks::EndLost(TimeNs lost_ns, TimeNs searched_ns) {
  settled_.clear();
  for (auto track = tracks_.begin(); track != tracks_.end();) {
    if (track->follower->last_tentative_ns() >= lost_ns) {
      ++track;
      continue;
    }
    EmitRowsOf(&*track, searched_ns, searched_ns, kExtrapolatedSigmaShare);
    ReportEnd(*track);
    Trace(*track, TrackState::kDeleted, Rejection::kLost);
    track = tracks_.erase(track);
  }
  return settled_;
}

void ConfirmedTracks::Close(TimeNs newest_ns) {
  settled_.clear();
  for (Track& track : tracks_) {
    EmitRowsOf(&track, std::numeric_limits<TimeNs>::max() / 2, newest_ns, 1.0);
    ReportEnd(track);
    Trace(track, TrackState::kDeleted, Rejection::kNone);
  }
  tracks_.clear();
}

void ConfirmedTracks::Forget(TimeNs oldest_ns) {
  for (const Track& track : tracks_) {
    if (track.is_reported) oldest_ns = std::min(oldest_ns, track.emitted_until_ns);
  }
  instants_.Forget(oldest_ns);
}

void ConfirmedTracks::ReportEnd(const Track& track) {
  if (!track.is_reported) return;
  on_event_(TrackEnded{track.id, track.follower->last_evidence_ns(), track.kind.kind()});
}

// Interval in which the target existed, same as ExistenceInterval(), without the part reported.
TimeInterval ConfirmedTracks::PresenceOf(const Track& track, TimeNs until_ns) const {
  const std::vector<Measurement>& measurements = track.follower->fit().measurements();
  const TimeNs half_ns = period_ns_ / 2;
  TimeInterval presence = WithUndetected(
      {measurements.front().time_ns - half_ns, track.follower->last_evidence_ns() + half_ns},
      measurements, period_ns_, config_.trajectory.min_missed_run_probability);
  if (track.is_reported) presence.begin_ns = track.emitted_until_ns + 1;
  presence.end_ns = std::min(until_ns, presence.end_ns);
  return presence;
}

void ConfirmedTracks::SetSource(const Track& track, const TimeInterval& presence,
                                double max_sigma_m) {
  const TrackFollower& follower = *track.follower;
  source_.track_id = track.id;
  source_.trajectory = follower.fit().trajectory();
  source_.trajectory.origin_ns += follower.time_bias_ns();
  source_.presence = presence;
  source_.common_errors = follower.common_errors();
  SetViewpoints(follower.fit().measurements(), &source_.viewpoints);
  source_.covariance_inflations.clear();
  source_.max_sigma_m = max_sigma_m;
}

void ConfirmedTracks::Predict(TimeNs newest_ns) {
  due_.SetList(&newest_ns, &newest_ns + 1);
  for (const Track& track : tracks_) {
    if (!track.is_reported) continue;
    SetSource(track, {newest_ns, newest_ns}, std::numeric_limits<double>::infinity());
    const TimeNs fitted_ns = newest_ns - track.follower->time_bias_ns();
    source_.covariance_inflations.push_back(
        {newest_ns, track.follower->fit().PredictionInflationM2(fitted_ns)});
    RowSampler rows(source_, due_);
    const std::optional<TrajectoryRow> row = rows.Next();
    if (!row) continue;
    const TimeNs seen_ns = track.follower->last_evidence_ns() + track.follower->time_bias_ns();
    const double unseen_s = SecondsOf(newest_ns - seen_ns);
    on_event_(TrackPredicted{*row, std::max(unseen_s, 0.0), track.kind.kind()});
  }
}

// Emits the rows of a track until `until_ns` if it is accepted as a drone, and appends the plots
// that they settle to settled_.
void ConfirmedTracks::EmitRowsOf(Track* track, TimeNs until_ns, TimeNs newest_ns,
                                 double extrapolated_share) {
  if (!track->verdict) return;
  if (track->verdict->rejection != Rejection::kNone) {
    unreported_.clear();
    track->follower->Settle(until_ns - NsOf(kMaxUnreportedS), &unreported_);
    return;
  }
  instants_.GetBetween(track->emitted_until_ns, until_ns, &due_);
  TrackFollower& follower = *track->follower;
  // Predict() needs the newest fit, with or without rows.
  if (due_.size() > 0 || (track->is_reported && follower.has_new_plots())) follower.Fit(fitter_);
  if (due_.size() == 0) return;
  track->kind.Observe(follower.fit().trajectory(), until_ns);
  const Kind kind = track->kind.kind();
  if (!track->is_reported) track->id = next_id_++;
  SetSource(*track, PresenceOf(*track, until_ns), config_.trajectory.max_sigma_m);
  if (!std::exchange(track->is_reported, true)) {
    track->emitted_until_ns = source_.presence.begin_ns - 1;
    on_event_(TrackConfirmed{track->id, follower.first_evidence_ns(), kind});
    Trace(*track, TrackState::kConfirmed, Rejection::kNone);
  }
  RowSampler rows(source_, due_);
  const TimeNs late_before_ns = newest_ns - NsOf(config_.live.delay_s) - period_ns_;
  const TimeInterval seen{follower.fit().measurements().front().time_ns + follower.time_bias_ns(),
                          follower.last_evidence_ns() + follower.time_bias_ns()};
  const double max_extrapolated_sigma_m = extrapolated_share * source_.max_sigma_m;
  while (std::optional<TrajectoryRow> row = rows.Next()) {
    const bool is_extrapolated = row->time_ns < seen.begin_ns || row->time_ns > seen.end_ns;
    if (is_extrapolated && row->sigma_m.maxCoeff() > max_extrapolated_sigma_m) continue;
    const TimeInterval around = instants_.Around(row->time_ns);
    row->support = follower.fit().ReturnsBetween(around.begin_ns, around.end_ns);
    on_event_(RowGiven{*row, row->time_ns < late_before_ns, kind});
    track->emitted_until_ns = row->time_ns;
  }
  follower.Settle(track->emitted_until_ns, &settled_);
}

}  // namespace unlidar
