#include "live/live_tracker.hpp"

#include <algorithm>
#include <utility>

namespace unlidar {
namespace {

constexpr double kBodyHoldS = 0.1;  // plots wait for bodies beside them
// Waiting frames of the warm-up processed with each new frame.
constexpr std::size_t kBacklogPerFrame = 3;
constexpr double kCleanUpIntervalS = 2.0;
constexpr double kKeepPathsS = 30.0;  // maximum age of plots of unconfirmed paths

}  // namespace

LiveTracker::LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event)
    : config_(config),
      scene_(config_),
      search_(config_),
      tracks_(config_, search_.models(), std::move(output_times), std::move(on_event)) {}

void LiveTracker::SetSensor(std::uint32_t sensor, const SensorInfo& info) {
  search_.SetSensor(sensor, info, scene_.AddSensor(sensor, info.origin_m));
  tracks_.SetPeriod(search_.shortest_period_ns());
}

void LiveTracker::Take(LoadedFrame* frame) {
  tracks_.AddInstants(frame->info);
  if (scene_.Take(frame)) MakePlots(kBacklogPerFrame);
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
  tracks_.Close(newest_ns);
}

void LiveTracker::EmitRows(TimeNs newest_ns) {
  scene_.RemoveFromClutter(tracks_.EmitRows(searched_ns_, newest_ns));
}

void LiveTracker::MakePlots(std::size_t max_frames) {
  for (; scene_.num_waiting() > 0 && max_frames > 0; --max_frames) {
    const TimeNs middle_ns =
        scene_.MakePlots([&](const Eigen::Vector3f& place_m, double dwell_begin_s, double time_s) {
          return tracks_.HasTrackAt(place_m.cast<double>(), dwell_begin_s, time_s);
        });
    SearchUntil(middle_ns - NsOf(kBodyHoldS));
  }
}

void LiveTracker::SearchUntil(TimeNs until_ns) {
  while (scene_.Next(until_ns, &frame_)) Search();
}

void LiveTracker::Search() {
  const TimeNs middle_ns = frame_.info.middle_ns();
  searched_ns_ = std::max(searched_ns_, middle_ns);
  Confirm();
  tracks_.Judge(search_.seen(), frame_.time_s);
  const TimeNs lost_ns = middle_ns - NsOf(config_.robust.tracker.max_gap_s);
  scene_.RemoveFromClutter(tracks_.EndLost(lost_ns, searched_ns_));
  if (frame_.time_s - cleaned_up_s_ < kCleanUpIntervalS) return;
  cleaned_up_s_ = frame_.time_s;
  search_.Forget(middle_ns - NsOf(kKeepPathsS));
  scene_.Sweep(frame_.bin);
  tracks_.Forget(searched_ns_ - NsOf(kKeepPathsS));
}

// Extends the tracks and the search, and initiates tracks from the paths found.
void LiveTracker::Confirm() {
  const FrameTime& at = search_.Begin(frame_);
  const std::vector<char>& are_free = tracks_.Extend(frame_.plots, at);
  for (const Path& path : search_.Extend(frame_, are_free)) {
    const Flight* const flight = search_.FlightOf(path);
    if (flight == nullptr) continue;
    const auto with_history = [&](const Flight& its) { return search_.WithHistory(its); };
    if (tracks_.Initiate(*flight, search_.ScoreThresholdOf(path), with_history)) search_.Take(path);
  }
}

}  // namespace unlidar
