#include "live/live_search.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>

#include "collection/suspended.hpp"
#include "live/backward_extension.hpp"
#include "scene/support.hpp"
#include "tracking/crowding.hpp"
#include "tracking/flight.hpp"

namespace unlidar {
namespace {

// The clutter intensity is uncertain at first and while a sensor is blinded. Clutter then makes
// more paths than its mean rate predicts, because unexpected plots come in runs.
constexpr double kMaxClutterUncertaintyMargin = 16.0;
constexpr double kLearningS = 10.0;
// The same for a path with more neighbouring plots than its own.
constexpr double kCrowdedLearningS = 30.0;
// Recent plots at most, between frames: those of ten seconds before a low sun, and of all that is
// kept in dense rain.
constexpr std::size_t kMaxRecentPlots = 240'000;
// Across a gap of this length a path is within reach of strays of seconds before.
constexpr double kLongPauseS = 3.0;

// True if a path moves or is unsupported. Otherwise it may be a twig that is hit more often for a
// while: a stream does not know how often its place will be hit later.
bool MovesOrFloats(const std::vector<LivePlot>& path, const std::vector<Plot>& plots) {
  const double min_move_m = kMinDisplacement.At(plots.front().ray_m.norm());
  return Floats(path) || DriftM(plots) > min_move_m;
}

// Numbers of the plots of a path within it.
std::vector<std::uint32_t> AllOf(const Path& path) {
  std::vector<std::uint32_t> all(path.plots.size());
  std::iota(all.begin(), all.end(), 0U);
  return all;
}

template <class T>
void DropFirst(std::size_t count, std::vector<T>* values) {
  values->erase(values->begin(), values->begin() + static_cast<std::ptrdiff_t>(count));
}

}  // namespace

void LiveSearch::SetSensor(std::uint32_t sensor, const SensorInfo& info) {
  if (recent_.sensors.size() <= sensor) {
    recent_.sensors.resize(sensor + 1);
    scan_schedule_.sensors.resize(sensor + 1);
    frame_time_.frames_before.resize(sensor + 1, 0);
  }
  recent_.sensors[sensor] = info;
  scan_schedule_.sensors[sensor].frame_s =
      static_cast<double>(info.frame_period_ns) * kSecondsPerNs;
  const TrackerConfig& tracker = config_.robust.tracker;
  for (std::size_t m = 0; m < tracker.sigma_a_mps2.size(); ++m) {
    if (models_.size() <= m) models_.emplace_back(tracker.sigma_a_mps2[m], scan_schedule_, tracker);
    models_[m].SetScanSchedule(scan_schedule_);
    if (searches_.size() <= m) {
      searches_.emplace_back(log_births_, free_, models_[m], tracker);
    }
    searches_[m].SetModel(models_[m]);
  }
}

const FrameTime& LiveSearch::Begin(const SceneFrame& frame) {
  recent_.frames.push_back(frame.info);
  frame_time_.time_s = frame.time_s;
  frame_time_.sensor = frame.info.sensor;
  frame_time_.viewpoint_m = frame.viewpoint_m;
  return frame_time_;
}

// Updates the fading rate of plots. Sets birth_odds_ (plots), the odds of each plot to be the
// first of a path.
void LiveSearch::CountPlots(const SceneFrame& frame) {
  const double passed_s = std::max(0.0, frame.time_s - rate_time_s_);
  const double fade = std::exp(-passed_s / config_.live.window_s);
  rate_window_s_ = rate_window_s_ * fade + passed_s;
  odds_ *= fade;
  num_plots_ *= fade;
  rate_time_s_ = std::max(rate_time_s_, frame.time_s);
  birth_odds_.clear();
  for (const LivePlot& seen : frame.plots) {
    birth_odds_.push_back(
        std::exp(LogBirthOdds(seen.plot, scan_schedule_, config_.robust.tracker)));
    odds_ += birth_odds_.back();
    num_plots_ += 1.0;
  }
}

// Margin of the score threshold for the uncertainty of the clutter intensity, which falls by a
// factor of e per `learning_s`.
double LiveSearch::ClutterUncertaintyMargin(double learning_s) const {
  if (!config_.robust.Uses(Rule::kClutterLearning)) return 0.0;
  return is_blinded_ ? kMaxClutterUncertaintyMargin
                     : kMaxClutterUncertaintyMargin * std::exp(-observed_s_ / learning_s);
}

// Per hour, at the present rate of plots.
double LiveSearch::RecentScoreThreshold() const {
  const double plots_per_hour = 3600.0 * num_plots_ / std::max(rate_window_s_, 1.0);
  return ScoreThreshold(plots_per_hour, config_.live.false_alarms_per_hour,
                        config_.robust.tracker) +
         ClutterUncertaintyMargin(kLearningS);
}

const Queue<Path>& LiveSearch::Extend(const SceneFrame& frame, const std::vector<char>& are_free) {
  CountPlots(frame);
  paths_.clear();
  if (frame.is_searched() && !frame.plots.empty()) {
    const std::size_t first = recent_plots_.size();
    frame_times_.Add(frame.plots.front().plot.frame, frame_time_);
    frame_plots_.clear();
    for (std::size_t i = 0; i < frame.plots.size(); ++i) {
      const double uniform = config_.robust.tracker.uniform_birth_share;
      log_births_.push_back(
          std::log(uniform + (1.0 - uniform) * birth_odds_[i] * num_plots_ / odds_));
      frame_plots_.push_back(frame.plots[i].plot);
      recent_plots_.push_back(frame.plots[i]);
      free_.push_back(are_free[i]);
    }
    SetScan(frame_plots_.data(), frame_plots_.size(), log_births_, first, frame_time_, &scan_);
    observed_s_ = frame.observed_s;
    score_threshold_ = RecentScoreThreshold();
    for (TrackSearch& search : searches_) {
      search.Extend(scan_);
      search.AppendPathsToLastScan(score_threshold_, &paths_);
    }
    std::sort(paths_.begin(), paths_.end(), [](const Path& a, const Path& b) {
      return a.score > b.score || (a.score == b.score && a.plots < b.plots);
    });
  }
  ++frame_time_.frames_before[frame.info.sensor];
  return paths_;
}

bool LiveSearch::IsFree(const Path& path) const {
  return std::all_of(path.plots.begin(), path.plots.end(),
                     [&](std::uint32_t i) { return free_[i] != 0; });
}

// Scores paths of the plots of `path`, as they are numbered there. Valid until the next call.
PathScorer LiveSearch::ScorerOf(const Path& path, TimeOutOfView time_out_of_view) {
  path_plots_.clear();
  path_log_births_.clear();
  for (const std::uint32_t i : path.plots) {
    path_plots_.push_back(recent_plots_[i].plot);
    path_log_births_.push_back(log_births_[i]);
  }
  std::vector<TrackModel> models;
  for (const TrackModel& model : models_) models.push_back(model.With(time_out_of_view));
  return PathScorer(
      path_plots_, path_log_births_, std::move(models),
      [this](const Plot& plot) { return frame_times_.At(plot.frame); }, config_.robust.tracker);
}

// As in a recording: each plot keeps few hypotheses, so what is likelier only by later plots may
// have been displaced.
const Path& LiveSearch::Pruned(const Path& path) {
  if (!IsFree(path)) return path;
  const PathScorer scorer = ScorerOf(path, TimeOutOfView::kNone);
  pruned_ = scorer.WithScore(AllOf(path));
  while (DropStretch(scorer, Droppable::kRunsBeforeLast, &pruned_)) {
  }
  for (std::uint32_t& plot : pruned_.plots) plot = path.plots[plot];
  return pruned_;
}

// Number of plots before the last long pause across which a path is not one target, as paths of a
// recording join. A higher score is not enough for that: a few strays before a pause raise it, too,
// though they explain themselves as well without what comes after it.
std::size_t LiveSearch::NumBeforePause(const Path& path) {
  std::vector<std::size_t> after_pauses;
  for (std::size_t i = 1; i < path.plots.size() && config_.robust.Uses(Rule::kPause); ++i) {
    const double before_s = recent_plots_[path.plots[i - 1]].time_s;
    if (recent_plots_[path.plots[i]].time_s - before_s >= kLongPauseS) after_pauses.push_back(i);
  }
  if (after_pauses.empty()) return 0;
  const PathScorer scorer = ScorerOf(path, TimeOutOfView::kLogUniform);
  std::size_t first = 0;
  Path rest;
  rest.plots = AllOf(path);
  for (const std::size_t i : after_pauses) {
    if (IsOneTarget(scorer, rest, i - first)) continue;
    DropFirst(i - first, &rest.plots);
    first = i;
  }
  return first;
}

Rejection LiveSearch::Judge(const Path& path) {
  Flight& flight = flight_;
  std::vector<Plot>& plots = flight_plots_;
  flight.plots.clear();
  plots.clear();
  cuts_.clear();
  if (!IsFree(path)) return Rejection::kSharesReturns;
  for (const std::uint32_t i : path.plots) {
    flight.plots.push_back(recent_plots_[i]);
    plots.push_back(recent_plots_[i].plot);
  }
  const RobustConfig& robust = config_.robust;
  const std::size_t first = NumBeforePause(path);
  if (first > 0) {
    cuts_.push_back({Rejection::kPause, first});
    DropFirst(first, &flight.plots);
    DropFirst(first, &plots);
  }
  const Rejection rejection = FlightRejection(recent_, plots, robust);
  if (rejection != Rejection::kNone) return rejection;
  if (robust.Uses(Rule::kStationary) && !MovesOrFloats(flight.plots, plots)) {
    return Rejection::kStationary;
  }
  flight.frame_times.clear();
  for (const Plot& plot : plots) flight.frame_times.push_back(frame_times_.At(plot.frame));
  flight.log_birth = log_births_[path.plots[first]];
  flight.starts_new_target = first > 0;
  return Rejection::kNone;
}

// True if more other plots lie within reach of the flight than it has itself.
bool LiveSearch::IsCrowded(const Path& path) const {
  const std::vector<LivePlot>& flight = flight_.plots;
  const auto is_about = [&](const LivePlot& other) {
    return std::any_of(flight.begin(), flight.end(), [&](const LivePlot& seen) {
      const double reach_m = SupportReachM(seen.plot.ray_m.norm(), config_.robust.support);
      return (other.plot.position_m - seen.plot.position_m).squaredNorm() < reach_m * reach_m;
    });
  };
  std::size_t others = 0;
  auto own = path.plots.begin();
  for (std::uint32_t i = 0; i < recent_plots_.size(); ++i) {
    if (own != path.plots.end() && *own == i) {
      ++own;
    } else if (is_about(recent_plots_[i]) && ++others > flight.size()) {
      return true;
    }
  }
  return false;
}

// Penalty of the plots of the flight, which are the last of the path.
double LiveSearch::CrowdingPenaltyOf(const Path& path) const {
  const TimeNs reach_ns = NsOf(kCrowdingReachS);
  const TimeNs begin_ns = flight_plots_.front().frame_time_ns - reach_ns;
  const TimeNs end_ns = flight_plots_.back().frame_time_ns + reach_ns;
  const auto first = std::partition_point(
      recent_plots_.begin(), recent_plots_.end(),
      [&](const LivePlot& seen) { return seen.plot.frame_time_ns < begin_ns; });
  std::vector<Plot> plots;
  for (auto at = first; at != recent_plots_.end() && at->plot.frame_time_ns <= end_ns; ++at) {
    plots.push_back(at->plot);
  }
  const std::ptrdiff_t num_before = first - recent_plots_.begin();
  const std::vector<char> are_free(free_.begin() + num_before, free_.end());
  const auto size = static_cast<std::ptrdiff_t>(flight_.plots.size());
  std::vector<std::uint32_t> own(path.plots.end() - size, path.plots.end());
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

// Unsupported detections have no neighbours by definition. To a sensor that travels the clutter of
// most places never becomes known at other times, so what is there at the time counts as that of a
// recording does.
double LiveSearch::ScoreThresholdOf(const Path& path) const {
  if (!config_.robust.Uses(Rule::kCrowded)) return score_threshold_;
  if (Floats(flight_.plots)) return score_threshold_;
  if (flight_plots_.back().IsFromTravel()) return score_threshold_ + CrowdingPenaltyOf(path);
  if (!IsCrowded(path)) return score_threshold_;
  return score_threshold_ - ClutterUncertaintyMargin(kLearningS) +
         ClutterUncertaintyMargin(kCrowdedLearningS);
}

Flight LiveSearch::WithHistory(const Flight& flight, const Path& path) {
  Flight whole = flight;
  if (flight.starts_new_target) return whole;
  std::vector<std::size_t> past = ExtendBackwards(flight, recent_plots_, free_, frame_times_,
                                                  frame_time_.frames_before, models_, config_);
  Path judged;
  for (const std::size_t i : past) judged.plots.push_back(static_cast<std::uint32_t>(i));
  judged.plots.insert(judged.plots.end(), path.plots.begin(), path.plots.end());
  DropFirst(std::min(NumBeforePause(judged), past.size()), &past);
  std::vector<LivePlot> before;
  std::vector<FrameTime> frame_times;
  for (const std::size_t i : past) {
    before.push_back(recent_plots_[i]);
    frame_times.push_back(frame_times_.At(recent_plots_[i].plot.frame));
    free_[i] = 0;
  }
  whole.plots.insert(whole.plots.begin(), before.begin(), before.end());
  whole.frame_times.insert(whole.frame_times.begin(), frame_times.begin(), frame_times.end());
  return whole;
}

void LiveSearch::GetScores(std::vector<double>* scores) const {
  scores->assign(scan_.last - scan_.first, 0.0);
  for (const TrackSearch& search : searches_) search.RaiseScores(scan_.first, scores);
}

void LiveSearch::Take(const Path& path) {
  for (const std::uint32_t i : path.plots) free_[i] = 0;
  for (TrackSearch& search : searches_) search.DropAssigned();
}

bool LiveSearch::IsFull() const { return recent_plots_.size() > kMaxRecentPlots; }

std::size_t LiveSearch::Forget(TimeNs oldest_ns) {
  const auto kept =
      std::find_if(recent_plots_.begin(), recent_plots_.end(),
                   [&](const LivePlot& seen) { return seen.plot.frame_time_ns >= oldest_ns; });
  auto gone = static_cast<std::size_t>(kept - recent_plots_.begin());
  if (IsFull()) gone = std::max(gone, recent_plots_.size() - 3 * kMaxRecentPlots / 4);
  for (TrackSearch& search : searches_) search.Forget(gone);
  recent_plots_.DropFirst(gone);
  DropFirst(gone, &log_births_);
  DropFirst(gone, &free_);
  if (!recent_plots_.empty()) frame_times_.Forget(recent_plots_.front().plot.frame);
  const auto frame =
      std::find_if(recent_.frames.begin(), recent_.frames.end(),
                   [&](const FrameInfo& info) { return info.begin_ns >= oldest_ns; });
  recent_.frames.erase(recent_.frames.begin(), frame);
  return gone;
}

}  // namespace unlidar
