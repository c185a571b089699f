#include "live/live_tracker.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace unlidar {
namespace {

constexpr double kBodyHoldS = 0.1;  // plots wait so long for a body that may show beside them
// Frames that wait since the begin, with each new one.
constexpr std::size_t kWaitingAtOnce = 3;
constexpr std::size_t kWaitingAhead = 10;
constexpr TimeNs kAheadNs = 800'000'000;  // what the first look learns from, before it looks
constexpr int kAheadHypotheses = 2;       // times as many as the other pass carries on
constexpr double kTidyS = 2.0;
constexpr double kKeepPathsS = 30.0;  // a path that is not confirmed by then has no older part

// To the first look what stands is no clutter yet: it crowds out the few first sightings of what
// flies.
Config OfFirstLook(Config config) {
  config.robust.tracker.max_hypotheses *= kAheadHypotheses;
  return config;
}

}  // namespace

LiveTracker::Pass::Pass(const Config& config, Look its_look, TimeNs warm_up_ns)
    : look(its_look), scene(config, warm_up_ns), search(config, its_look == Look::kFirst) {}

LiveTracker::LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event)
    : config_(config),
      ahead_config_(OfFirstLook(config)),
      whole_(config_, Look::kWhole, kWarmUpNs),
      ahead_(std::make_unique<Pass>(ahead_config_, Look::kFirst, kAheadNs)),
      tracks_(config_, whole_.search.models(), std::move(output_times), std::move(on_event)) {}

void LiveTracker::SetSensor(std::uint32_t sensor, const SensorInfo& info) {
  for (Pass* const pass : {&whole_, ahead_.get()}) {
    if (pass == nullptr) continue;
    pass->search.SetSensor(sensor, info, pass->scene.AddSensor(sensor, info.origin_m));
  }
  tracks_.SetPeriod(whole_.search.shortest_period_ns());
}

void LiveTracker::Take(LoadedFrame* frame) {
  tracks_.AddInstants(frame->info);
  if (ahead_) TakeAhead(*frame);
  const bool was_warm = is_warm();
  if (whole_.scene.Take(frame)) MakePlots(&whole_, kWaitingAtOnce);
  if (is_warm() && !was_warm) tracks_.LeaveUntold();
}

// Sensors that are heard later are left to the other pass, so that both count the same frames.
void LiveTracker::TakeAhead(const LoadedFrame& frame) {
  const std::uint32_t sensor = frame.info.sensor;
  if (are_of_begin_.size() <= sensor) are_of_begin_.resize(sensor + 1, 0);
  if (!ahead_->scene.is_warm()) are_of_begin_[sensor] = 1;
  if (!are_of_begin_[sensor]) return;
  copy_ = frame;
  if (ahead_->scene.Take(&copy_)) MakePlots(ahead_.get(), kWaitingAhead);
}

void LiveTracker::Advance(TimeNs settled_ns, TimeNs now_ns) {
  const auto go_on = [&](Pass* pass, std::size_t most) {
    if (!pass->scene.is_warm()) return;
    MakePlots(pass, most);
    if (pass->scene.num_waiting() == 0) SearchUntil(pass, settled_ns - HoldNs(pass->look));
  };
  if (ahead_) go_on(ahead_.get(), kWaitingAhead);
  go_on(&whole_, kWaitingAtOnce);
  GiveRows(now_ns);
}

void LiveTracker::Close(TimeNs newest_ns) {
  whole_.scene.Close();
  MakePlots(&whole_, whole_.scene.num_waiting());
  SearchUntil(&whole_, std::numeric_limits<TimeNs>::max());
  tracks_.Close(newest_ns);
}

void LiveTracker::GiveRows(TimeNs newest_ns) {
  for (Pass* const pass : {&whole_, ahead_.get()}) {
    if (pass == nullptr) continue;
    pass->scene.Explain(tracks_.GiveRows(pass->look, pass->searched_ns, newest_ns));
  }
}

// What the first look takes for a track is higher than bodies are. When it takes nothing more it
// waits as the other pass does, which otherwise would never come as far.
TimeNs LiveTracker::HoldNs(Look look) const {
  return look == Look::kFirst && !is_warm() ? 0 : NsOf(kBodyHoldS);
}

void LiveTracker::MakePlots(Pass* pass, std::size_t most) {
  for (; pass->scene.num_waiting() > 0 && most > 0; --most) {
    const TimeNs middle_ns =
        pass->scene.MakePlots([&](const Eigen::Vector3f& place_m, double since_s, double time_s) {
          return tracks_.HasAt(pass->look, place_m.cast<double>(), since_s, time_s);
        });
    SearchUntil(pass, middle_ns - HoldNs(pass->look));
  }
}

void LiveTracker::SearchUntil(Pass* pass, TimeNs until_ns) {
  while (pass->scene.Next(until_ns, &pass->frame)) Search(pass);
}

void LiveTracker::Search(Pass* pass) {
  const TimeNs middle_ns = pass->frame.info.middle_ns();
  const double time_s = pass->frame.time_s;
  pass->searched_ns = std::max(pass->searched_ns, middle_ns);
  Confirm(pass);
  tracks_.Judge(pass->look, pass->search.seen(), time_s);
  const TimeNs lost_ns = middle_ns - NsOf(config_.robust.tracker.max_gap_s);
  pass->scene.Explain(tracks_.EndLost(pass->look, lost_ns, pass->searched_ns));
  if (pass == &whole_ && ahead_ && whole_.searched_ns >= ahead_->searched_ns) {
    tracks_.HandOver();
    ahead_.reset();
    copy_ = LoadedFrame();
  }
  if (time_s - pass->tidied_s < kTidyS) return;
  pass->tidied_s = time_s;
  pass->search.Forget(middle_ns - NsOf(kKeepPathsS));
  pass->scene.Sweep(time_s);
  tracks_.Forget(pass->searched_ns - NsOf(kKeepPathsS));
}

// Goes on with its tracks and its search, and takes what that finds for tracks. The first look
// finds no more when the other pass does.
void LiveTracker::Confirm(Pass* pass) {
  const SceneFrame& frame = pass->frame;
  LiveSearch& search = pass->search;
  const Moment& at = search.Begin(frame);
  const std::vector<char>& are_free = tracks_.Extend(pass->look, frame.plots, at);
  const Queue<Path>& paths = search.Extend(frame, are_free);
  const bool is_first = pass->look == Look::kFirst;
  if (is_first && is_warm()) return;
  for (const Path& path : paths) {
    const Flight* const flight = search.FlightOf(path);
    if (flight == nullptr || (is_first && !search.IsAlone(path))) continue;
    const auto with_past = [&](const Flight& its) { return search.WithPast(its); };
    if (tracks_.Begin(pass->look, *flight, search.LeastScoreOf(path), with_past)) search.Take(path);
  }
}

}  // namespace unlidar
