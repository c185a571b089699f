#include "live/live_search.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/algorithms.hpp"

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

}  // namespace

void LiveSearch::SetSensor(std::uint32_t sensor, const SensorInfo& info) {
  if (recent_.sensors.size() <= sensor) {
    recent_.sensors.resize(sensor + 1);
    scan_schedule_.sensors.resize(sensor + 1);
    frame_time_.frames_before.resize(sensor + 1, 0);
  }
  recent_.sensors[sensor] = info;
  scan_schedule_.sensors[sensor].frame_s = SecondsOf(info.frame_period_ns);
  const RobustConfig& robust = config_.robust;
  const TrackerConfig& tracker = robust.tracker;
  for (std::size_t m = 0; m < tracker.sigma_a_mps2.size(); ++m) {
    if (models_.size() <= m) {
      models_.emplace_back(tracker.sigma_a_mps2[m], scan_schedule_, tracker);
      searches_.emplace_back(
          log_births_, free_, models_[m], tracker,
          robust.Uses(Rule::kGroundPast) ? robust.off_ground_m : kNoGroundTargetsM, true);
    }
    models_[m].SetScanSchedule(scan_schedule_);
    searches_[m].SetModel(models_[m]);
  }
}

const FrameTime& LiveSearch::Begin(const SceneFrame& frame) {
  recent_.frames.push_back(frame.info);
  for (const BodyBox& body : frame.bodies) InsertInOrder(body, &recent_bodies_);
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

const Queue<Path>& LiveSearch::Extend(const SceneFrame& frame, const std::vector<char>& are_free) {
  CountPlots(frame);
  paths_.clear();
  ++num_scans_;
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
      verdicts_.emplace_back();
      refusals_.emplace_back();
    }
    SetScan(frame_plots_.data(), frame_plots_.size(), log_births_, first, frame_time_, &scan_);
    observed_s_ = frame.observed_s;
    const double plots_per_hour = 3600.0 * num_plots_ / std::max(rate_window_s_, 1.0);
    score_threshold_ =
        ScoreThreshold(plots_per_hour, config_.live.false_alarms_per_hour, config_.robust.tracker) +
        ClutterUncertaintyMargin(kLearningS);
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

// Unsupported detections have no neighbours by definition. To a sensor that travels the clutter of
// most places never becomes known at other times, so what is there at the time counts as that of a
// recording does.
double LiveSearch::ScoreThresholdOfFlight() const {
  if (!config_.robust.Uses(Rule::kCrowded)) return score_threshold_;
  if (Floats(flight_.plots)) return score_threshold_;
  if (flight_.plots.back().plot.IsFromTravel()) return score_threshold_ + CrowdingPenaltyOfFlight();
  if (!IsCrowded()) return score_threshold_;
  return score_threshold_ - ClutterUncertaintyMargin(kLearningS) +
         ClutterUncertaintyMargin(kCrowdedLearningS);
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
  std::size_t gone = recent_plots_.PartitionPoint(
      [&](const LivePlot& seen) { return seen.plot.frame_time_ns < oldest_ns; });
  if (IsFull()) gone = std::max(gone, recent_plots_.size() - 3 * kMaxRecentPlots / 4);
  for (TrackSearch& search : searches_) search.Forget(gone);
  recent_plots_.DropFirst(gone);
  DropFirst(gone, &log_births_);
  DropFirst(gone, &free_);
  DropFirst(gone, &verdicts_);
  DropFirst(gone, &refusals_);
  if (!recent_plots_.empty()) frame_times_.Forget(recent_plots_.front().plot.frame);
  const auto frame =
      std::find_if(recent_.frames.begin(), recent_.frames.end(),
                   [&](const FrameInfo& info) { return info.begin_ns >= oldest_ns; });
  recent_.frames.erase(recent_.frames.begin(), frame);
  while (!recent_bodies_.empty() && recent_bodies_.front().time_ns < oldest_ns) {
    recent_bodies_.pop_front();
  }
  return gone;
}

}  // namespace unlidar
