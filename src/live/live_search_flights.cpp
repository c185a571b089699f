// The paths of a search as flights: judged, and followed back.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "base/algorithms.hpp"
#include "live/live_search.hpp"
#include "live/track_follower.hpp"
#include "scene/support.hpp"

namespace unlidar {
namespace {

// Across a pause of this length a path is within reach of strays of seconds before.
constexpr TimeNs kLongPauseNs = 3'000'000'000;

// A verdict stands until a path has grown by this share of its plots. A flight that goes on from a
// path of something else waits for no more than a flight of its own would need.
constexpr double kStandingShare = 0.1;

// True if a path moves or is unsupported. Otherwise it may be a twig that is hit more often for a
// while: a stream does not know how often its place will be hit later.
bool MovesOrFloats(const std::vector<LivePlot>& path, const std::vector<Plot>& plots) {
  const double min_move_m = kMinDisplacement.At(plots.front().ray_m.norm());
  return Floats(path) || DisplacementM(plots).norm() > min_move_m;
}

}  // namespace

bool LiveSearch::IsFree(const Path& path) const {
  return std::all_of(path.plots.begin(), path.plots.end(),
                     [&](std::uint32_t i) { return free_[i] != 0; });
}

void LiveSearch::SetPath(const Members& members) {
  path_plots_.clear();
  for (const std::uint32_t i : members) path_plots_.push_back(recent_plots_[i].plot);
  path_log_births_ = ValuesAt(members, log_births_);
}

// Scores paths of path_plots_.
PathScorer LiveSearch::Scorer(TimeOutOfView time_out_of_view) const {
  std::vector<TrackModel> models;
  for (const TrackModel& model : models_) models.push_back(model.With(time_out_of_view));
  return PathScorer(
      path_plots_, path_log_births_, std::move(models),
      [this](const Plot& plot) { return frame_times_.At(plot.frame); }, config_.robust.tracker);
}

Rejection LiveSearch::StandingRejection(const Path& path) {
  if (path.plots.size() < 2) return Rejection::kNone;
  const StandingVerdict& before = verdicts_[*(path.plots.end() - 2)];
  if (before.num_plots == 0) return Rejection::kNone;
  verdicts_[path.plots.back()] = {before.rejection, before.num_plots - 1};
  Refuse(path.plots, before.rejection);
  return before.rejection;
}

// Gives the plots of a path of this frame to what it is of, if that is no drone.
void LiveSearch::Refuse(const Members& members, Rejection rejection) {
  if (!TellsNoDrone(rejection)) return;
  for (const std::uint32_t i : members) refusals_[i] = {num_scans_, rejection};
}

void LiveSearch::GetGroundGains(const SceneFrame& frame, std::vector<double>* gains) const {
  constexpr double kMaxPauseS = 1.0;
  if (!config_.robust.Uses(Rule::kGroundClaim)) return gains->clear();
  const auto is_low = [&](const Plot& plot) {
    return plot.lowest_m <= config_.robust.off_ground_m;
  };
  const auto is_ground_target = [&](const Hypothesis& h) {
    const auto last = static_cast<std::size_t>(h.plot);
    return h.score >= score_threshold_ && frame_time_.time_s - h.time_s < kMaxPauseS &&
           is_low(recent_plots_[last].plot) && refusals_[last].rejection == Rejection::kNearGround;
  };
  gains->assign(frame.plots.size(), 0.0);
  for (std::size_t i = 0; i < frame.plots.size(); ++i) {
    const Plot& plot = frame.plots[i].plot;
    if (!is_low(plot)) continue;
    for (const TrackSearch& search : searches_) {
      (*gains)[i] = std::max((*gains)[i], search.GainOf(plot, frame_time_, is_ground_target));
    }
  }
}

// Returns the rule that refused the likelier paths of this frame to which most of these plots
// belong: a path of some of them and of strays would pass it.
Rejection LiveSearch::RejectionOfLikelier(const Members& members) const {
  if (!config_.robust.Uses(Rule::kLikelierRefusal)) return Rejection::kNone;
  std::size_t num_refused = 0;
  Rejection rejection = Rejection::kNone;
  for (const std::uint32_t i : members) {
    if (refusals_[i].scan != num_scans_) continue;
    ++num_refused;
    rejection = refusals_[i].rejection;
  }
  return 2 * num_refused > members.size() ? rejection : Rejection::kNone;
}

void LiveSearch::LetStand(Rejection rejection, const Path& path) {
  if (rejection == Rejection::kTooFewDetections) return;  // the next plot may be the one it lacks
  if (is_of_likelier_) return;                            // its next plots may be a drone's
  const auto share =
      static_cast<std::uint32_t>(kStandingShare * static_cast<double>(path.plots.size()));
  const auto most = static_cast<std::uint32_t>(config_.robust.min_plots);
  verdicts_[path.plots.back()] = {rejection, std::min(share, most)};
}

// As in a recording: each plot keeps few hypotheses, so what is likelier only by later plots may
// have been displaced.
const Path& LiveSearch::Pruned(const Path& path) {
  if (!IsFree(path)) return path;
  SetPath(path.plots);
  const PathScorer scorer = Scorer(TimeOutOfView::kNone);
  pruned_ = scorer.WithScore(NumbersBelow(path_plots_.size()));
  while (DropStretch(scorer, Droppable::kRunsBeforeLast, &pruned_)) {
  }
  for (std::uint32_t& plot : pruned_.plots) plot = path.plots[plot];
  return pruned_;
}

// Leaves of all of path_plots_ those behind the last pause across which they are not one target, as
// paths of a recording join. A higher score is not enough for that: a few strays before a long
// pause raise it, too, though they explain themselves as well without what comes after it. Before a
// shorter one must be a path by itself that is no drone.
Members LiveSearch::LeftAtPauses() const {
  Path path;
  path.plots = NumbersBelow(path_plots_.size());
  if (!config_.robust.Uses(Rule::kPause)) return path.plots;
  const auto other_side_of = [&](const auto& before, const auto& after) {
    const TimeNs pause_ns = path_plots_[after.front()].time_ns - path_plots_[before.back()].time_ns;
    const bool is_other = pause_ns >= kLongPauseNs || Gates().IsNoDrone(before);
    return is_other ? OtherSide::kBefore : OtherSide::kNone;
  };
  CutAtPauses(Scorer(TimeOutOfView::kLogUniform), other_side_of, &path);
  return path.plots;
}

Flight LiveSearch::FlightOf(const Members& members) const {
  Flight flight;
  for (const std::uint32_t i : members) {
    flight.plots.push_back(recent_plots_[i]);
    flight.frame_times.push_back(frame_times_.At(recent_plots_[i].plot.frame));
  }
  flight.log_birth = log_births_[members.front()];
  return flight;
}

Rejection LiveSearch::Judge(const Path& path) {
  cuts_.clear();
  is_of_likelier_ = false;
  flight_members_ = path.plots;
  if (!IsFree(path)) return Rejection::kSharesReturns;
  SetPath(path.plots);
  const Members left = LeftAtPauses();
  if (left.front() > 0) {
    cuts_.push_back({Rejection::kPause, left.front()});
    DropFirst(left.front(), &flight_members_);
  }
  const Rejection of_likelier = RejectionOfLikelier(flight_members_);
  is_of_likelier_ = of_likelier != Rejection::kNone;
  if (is_of_likelier_) return of_likelier;
  Rejection rejection = Gates().RejectionOf(left);
  if (rejection == Rejection::kNone) {
    flight_ = FlightOf(flight_members_);
    const bool is_at_rest = !MovesOrFloats(flight_.plots, ValuesAt(left, path_plots_));
    if (config_.robust.Uses(Rule::kStationary) && is_at_rest) rejection = Rejection::kStationary;
  }
  Refuse(flight_members_, rejection);
  return rejection;
}

// True if more other plots lie within reach of the flight than it has itself.
bool LiveSearch::IsCrowded() const {
  const std::vector<LivePlot>& flight = flight_.plots;
  const auto is_about = [&](const LivePlot& other) {
    return std::any_of(flight.begin(), flight.end(), [&](const LivePlot& seen) {
      const double reach_m = SupportReachM(seen.plot.ray_m.norm(), config_.robust.support);
      return (other.plot.position_m - seen.plot.position_m).squaredNorm() < reach_m * reach_m;
    });
  };
  const Members& own = flight_members_;
  std::size_t others = 0;
  for (std::uint32_t i = 0; i < recent_plots_.size() && others <= flight.size(); ++i) {
    if (is_about(recent_plots_[i]) && !std::binary_search(own.begin(), own.end(), i)) ++others;
  }
  return others > flight.size();
}

double LiveSearch::CrowdingPenaltyOfFlight() const {
  const TimeNs reach_ns = NsOf(kCrowdingReachS);
  const TimeNs begin_ns = flight_.plots.front().plot.frame_time_ns - reach_ns;
  const TimeNs end_ns = flight_.plots.back().plot.frame_time_ns + reach_ns;
  const std::size_t num_before = recent_plots_.PartitionPoint(
      [&](const LivePlot& seen) { return seen.plot.frame_time_ns < begin_ns; });
  std::vector<Plot> plots;
  for (std::size_t i = num_before; i < recent_plots_.size(); ++i) {
    if (recent_plots_[i].plot.frame_time_ns > end_ns) break;
    plots.push_back(recent_plots_[i].plot);
  }
  const std::vector<char> are_free(free_.begin() + static_cast<std::ptrdiff_t>(num_before),
                                   free_.end());
  Members own = flight_members_;
  for (std::uint32_t& plot : own) plot -= static_cast<std::uint32_t>(num_before);
  return CrowdingPenalty(own, plots, are_free, [&](const Plot& plot) {
    const auto is_about = [&](const FrameInfo& frame) {
      return frame.sensor == plot.sensor &&
             std::abs(frame.middle_ns() - plot.frame_time_ns) <= NsOf(kCrowdingReachS);
    };
    return static_cast<std::uint32_t>(
        std::count_if(recent_.frames.begin(), recent_.frames.end(), is_about));
  });
}

// Plots of a flight and those before it, back to a pause across which it is not one target.
Path LiveSearch::FollowedBack(const Members& members) {
  Path whole;
  whole.plots = ExtendBackwards(FlightOf(members), recent_plots_, free_, frame_times_,
                                frame_time_.frames_before, models_, config_.robust);
  const std::size_t num_past = whole.plots.size();
  whole.plots.insert(whole.plots.end(), members.begin(), members.end());
  SetPath(whole.plots);
  DropFirst(std::min<std::size_t>(LeftAtPauses().front(), num_past), &whole.plots);
  SetPath(whole.plots);
  whole.score =
      Scorer(TimeOutOfView::kLogUniform).WithScore(NumbersBelow(whole.plots.size())).score;
  return whole;
}

// A search keeps few hypotheses across a pause, so what a flight has before its last one may be
// another's plots: it is followed back from behind it, too.
Flight LiveSearch::WithHistory() {
  Path whole = FollowedBack(flight_members_);
  const auto are_apart = [&](std::uint32_t later, std::uint32_t earlier) {
    return recent_plots_[later].plot.time_ns - recent_plots_[earlier].plot.time_ns >= kLongPauseNs;
  };
  const auto after_pause =
      std::adjacent_find(flight_members_.rbegin(), flight_members_.rend(), are_apart);
  if (after_pause != flight_members_.rend()) {
    Path other = FollowedBack({std::prev(after_pause.base()), flight_members_.end()});
    if (other.score > whole.score) whole = std::move(other);
  }
  for (const std::uint32_t i : whole.plots) free_[i] = 0;
  return FlightOf(whole.plots);
}

}  // namespace unlidar
