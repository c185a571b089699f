#include "live/live_tracker.hpp"

#include <algorithm>
#include <utility>

#include "scene/occupancy.hpp"

namespace unlidar {
namespace {

constexpr double kBodyHoldS = 0.1;  // plots wait for bodies beside them
// Waiting frames of the warm-up processed with each new frame, and with a large one.
constexpr std::size_t kBacklogPerFrame = 3;
constexpr std::size_t kBacklogPerLargeFrame = 2;
constexpr double kCleanUpIntervalS = 2.0;
constexpr double kKeepPathsS = 30.0;  // maximum age of plots of unconfirmed paths

}  // namespace

LiveTracker::LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event,
                         LiveTraceSink trace)
    : config_(config),
      trace_(std::move(trace)),
      scene_(config_, trace_.is_on()),
      search_(config_),
      tracks_(config_, search_.models(), std::move(output_times), std::move(on_event), trace_) {}

void LiveTracker::SetSensor(std::uint32_t sensor, const SensorInfo& info) {
  scene_.AddSensor(sensor, info);
  search_.SetSensor(sensor, info);
  tracks_.SetPeriod(search_.shortest_period_ns());
}

void LiveTracker::Take(LoadedFrame* frame) {
  tracks_.AddInstants(frame->info);
  const bool was_warm = is_warm();
  const bool is_large = frame->points_m.size() > kManyReturns;
  if (scene_.Take(frame)) {
    MakePlots(is_large ? kBacklogPerLargeFrame : kBacklogPerFrame);
  } else if (was_warm && trace_.is_on()) {
    trace_.AddUnsearched(search_.SensorAt(frame->info.sensor), frame->info, frame->points_m.size());
  }
}

void LiveTracker::Advance(TimeNs settled_ns, TimeNs now_ns) {
  if (is_warm()) {
    MakePlots(kBacklogPerFrame);
    if (scene_.num_waiting() == 0) SearchUntil(settled_ns - NsOf(kBodyHoldS));
  }
  EmitRows(now_ns);
}

void LiveTracker::Close(TimeNs newest_ns) {
  scene_.Close();
  MakePlots(scene_.num_waiting());
  SearchUntil(std::numeric_limits<TimeNs>::max());
  tracks_.Judge(search_.seen(), frame_.time_s);
  tracks_.Close(newest_ns);
}

void LiveTracker::MakePlots(std::size_t max_frames) {
  for (; scene_.num_waiting() > 0 && max_frames > 0; --max_frames) {
    const TimeNs middle_ns = scene_.MakePlots(tracks_.TargetsAt(scene_.NextTimeS()));
    SearchUntil(middle_ns - NsOf(kBodyHoldS));
  }
}

void LiveTracker::Search() {
  const TimeNs middle_ns = frame_.info.middle_ns();
  searched_ns_ = std::max(searched_ns_, middle_ns);
  Confirm();
  // To follow a new track back takes long enough in a large frame: its first fit can wait.
  const bool is_large = frame_.info.last_return - frame_.info.first_return > kManyReturns;
  tracks_.Judge(search_.seen(), frame_.time_s, is_large);
  const TimeNs lost_ns = middle_ns - NsOf(config_.robust.tracker.max_gap_s);
  scene_.RemoveFromClutter(tracks_.EndLost(lost_ns, searched_ns_));
  if (trace_.is_on()) trace_.EndFrame(search_.SensorAt(frame_.info.sensor), frame_);
  if (frame_.time_s - cleaned_up_s_ < kCleanUpIntervalS && !search_.IsFull()) return;
  cleaned_up_s_ = frame_.time_s;
  trace_.Forget(search_.Forget(middle_ns - NsOf(kKeepPathsS)));
  scene_.Sweep(frame_.bin);
  tracks_.Forget(searched_ns_ - NsOf(kKeepPathsS));
}

// Extends the tracks and the search, and initiates tracks from the paths found.
void LiveTracker::Confirm() {
  const FrameTime& at = search_.Begin(frame_);
  ground_gains_.clear();
  if (tracks_.HasLost(at.time_s)) search_.GetGroundGains(frame_, &ground_gains_);
  const std::vector<char>& are_free = tracks_.Extend(frame_.plots, at, ground_gains_);
  const Queue<Path>& paths = search_.Extend(frame_, are_free);
  if (trace_.is_on()) TraceFrame();
  for (const Path& found : paths) {
    const Rejection standing = search_.StandingRejection(found);
    if (standing != Rejection::kNone) {
      if (trace_.is_on()) trace_.AddPath(found, {}, {found.score, 0.0, standing});
      continue;
    }
    const Path& path = search_.Pruned(found);
    const PathVerdict verdict = Decide(path);
    search_.LetStand(verdict.rejection, found);
    if (trace_.is_on()) trace_.AddPath(path, search_.cuts(), verdict);
  }
}

// Initiates a track from a path unless a rule refuses it.
PathVerdict LiveTracker::Decide(const Path& path) {
  PathVerdict verdict;
  verdict.log_likelihood_ratio = path.score;
  verdict.rejection = search_.Judge(path);
  // A path over a bridge that stays in the search is the likeliest way to any drone near it.
  if (verdict.rejection == Rejection::kOnStructure) search_.Take(path);
  if (verdict.rejection != Rejection::kNone) return verdict;
  const Flight& flight = search_.flight();
  const double score = tracks_.ScoreOf(flight);
  const double score_threshold = search_.ScoreThresholdOfFlight();
  verdict.crowding_penalty = score_threshold - search_.score_threshold();
  verdict.log_likelihood_ratio = score;
  if (score < score_threshold) {
    const bool is_crowded = score >= search_.score_threshold();
    verdict.rejection = is_crowded ? Rejection::kCrowded : Rejection::kBelowThreshold;
    return verdict;
  }
  if (tracks_.HasTrackOf(flight)) {
    verdict.rejection = Rejection::kPartOfAnotherTrack;
  } else {
    verdict.track = tracks_.Initiate(search_.WithHistory());
  }
  search_.Take(path);
  return verdict;
}

void LiveTracker::TraceFrame() {
  scores_.clear();
  if (frame_.is_searched() && !frame_.plots.empty()) search_.GetScores(&scores_);
  trace_.BeginFrame(frame_, search_.seen(), scores_, search_.score_threshold());
  for (std::size_t i = 0; i < frame_.plots.size(); ++i) trace_.SetTrack(i, tracks_.TrackOf(i));
}

}  // namespace unlidar
