#include "live/live_scene.hpp"

#include <algorithm>
#include <functional>
#include <optional>

namespace unlidar {
namespace {

constexpr TimeNs kFirstRefitNs = 1'500'000'000;
constexpr TimeNs kLastRefitNs = 10'000'000'000;
constexpr std::size_t kElevationReturns = 100'000;
constexpr std::int64_t kMaxPauseBins = 5;
// Averaging lengths in frames, and the factor and number of additional plots that mean a change
// of weather: no swarm is that large.
constexpr int kRecentFrames = 5;
constexpr int kTypicalFrames = 100;
constexpr double kSurgeFactor = 2.0;
constexpr double kSurgePlots = 30.0;

}  // namespace

LiveScene::Snapshot::Snapshot(const RobustConfig& config)
    : support(ground, config.background.occluder_cell_deg, config.support) {}

LiveScene::Station::Station(const Eigen::Vector3f& its_viewpoint_m, const Config& config)
    : viewpoint_m(its_viewpoint_m),
      occupancy(config.robust.background),
      clutter(config.robust, config.live.window_s) {}

LiveScene::LiveScene(const Config& config)
    : config_(config),
      bin_ns_(NsOf(config.robust.background.bin_s)),
      snapshot_interval_ns_(kFirstRefitNs) {}

Eigen::Vector3f LiveScene::AddSensor(std::uint32_t sensor, const Eigen::Vector3f& origin_m) {
  const std::size_t station = stations_.Add(sensor, origin_m);
  if (station == scenes_.size()) scenes_.emplace_back(stations_.ViewpointM(station), config_);
  return stations_.ViewpointM(station);
}

double LiveScene::SecondsOf(TimeNs time_ns) const {
  return static_cast<double>(time_ns - begin_ns_) * kSecondsPerNs;
}

// Time of the middle of a bin, exact if no pause has been skipped since.
double LiveScene::SecondsOfBin(std::int64_t bin) const {
  return (static_cast<double>(bin + bin_shift_) + 0.5) * static_cast<double>(bin_ns_) *
         kSecondsPerNs;
}

// A pause between frames takes only as many bins as end every dwell.
std::int64_t LiveScene::BinOf(TimeNs time_ns) {
  const std::int64_t slot = (time_ns - begin_ns_) / bin_ns_;
  if (slot > newest_slot_) {
    bin_shift_ += std::max<std::int64_t>(0, slot - newest_slot_ - kMaxPauseBins);
    newest_slot_ = slot;
  }
  return std::max<std::int64_t>(0, slot - bin_shift_);
}

LiveScene::Station& LiveScene::StationOf(std::uint32_t sensor) {
  return scenes_[stations_.StationOf(sensor)];
}

void LiveScene::SetBlinded(bool is_blinded) {
  for (Station& station : scenes_) station.clutter.SetBlinded(is_blinded);
}

bool LiveScene::Take(LoadedFrame* frame) {
  const FrameInfo& info = frame->info;
  const TimeNs middle_ns = info.middle_ns();
  if (!std::exchange(has_begun_, true)) {
    begin_ns_ = info.begin_ns;
    front_ns_ = middle_ns;
  }
  const std::int64_t bin = BinOf(middle_ns);
  front_ns_ = std::max(front_ns_, middle_ns);
  Station& station = StationOf(info.sensor);
  if (!std::exchange(station.has_begun, true)) {
    station.begin_ns = info.begin_ns;
    station.search_from_ns = station.begin_ns + kWarmUpNs;
    learning_since_ns_ = station.begin_ns;
  }
  station.occupancy.AddFrame(bin);
  for (Eigen::Vector3f& point_m : frame->points_m) {
    point_m -= station.viewpoint_m;
    station.occupancy.Add(point_m, bin);
    station.field_of_view.Add(point_m);
    if (!station.snapshot && station.early_returns_m.size() < kElevationReturns) {
      station.early_returns_m.push_back(point_m);
    }
  }
  const auto enqueue = [&] {
    auto& [waiting, its_bin] = waiting_.Append();
    std::swap(waiting, *frame);
    its_bin = bin;
  };
  if (!is_warm_) {
    enqueue();
    if (front_ns_ - begin_ns_ >= kWarmUpNs) WarmUp();
    return false;
  }
  if (!station.snapshot) {
    station.early.emplace_back(std::move(*frame), bin);
    if (front_ns_ - station.begin_ns >= kWarmUpNs) WarmUpLate(&station);
    return false;
  }
  if (front_ns_ - snapshot_ns_ >= snapshot_interval_ns_) RefitAll();
  enqueue();
  return true;
}

void LiveScene::Close() {
  if (has_begun_ && !is_warm_) WarmUp();
}

void LiveScene::Learn(const LoadedFrame& frame, std::int64_t bin, Station* station) {
  for (const Eigen::Vector3f& point_m : frame.points_m) {
    station->occupancy.Judge(point_m, bin, 0, [](const Eigen::Vector3f&) { return false; });
  }
}

// Judges the returns of the waiting frames once, then fits ground and support.
void LiveScene::WarmUp() {
  for (const auto& [frame, bin] : waiting_) Learn(frame, bin, &StationOf(frame.info.sensor));
  RefitAll();
  num_warm_up_frames_ = waiting_.size();
  if (front_ns_ - begin_ns_ < kWarmUpNs) return;
  for (Station& station : scenes_) {
    if (station.begin_ns - begin_ns_ < bin_ns_) station.search_from_ns = station.begin_ns;
  }
}

// Warm-up of a station that is added while others are warm: frames before its warm-up ends are
// not searched, and those of another warm-up period are used for clutter only.
void LiveScene::WarmUpLate(Station* station) {
  for (const auto& [frame, bin] : std::exchange(station->early, {})) Learn(frame, bin, station);
  station->search_from_ns = front_ns_ + kWarmUpNs;
  learning_since_ns_ = station->begin_ns;
  Refit(station);
}

void LiveScene::Refit(Station* station) {
  if (!station->early_returns_m.empty()) {
    station->lowest_elevation_rad = LowestElevationRad(std::exchange(station->early_returns_m, {}));
  }
  if (!station->snapshot) station->snapshot = std::make_unique<Snapshot>(config_.robust);
  auto& [points_m, ground, support] = workspace_;
  station->occupancy.GetStructure(&points_m);
  station->snapshot->ground.Fit(points_m, &ground);
  station->occupancy.GetSupporters(&points_m);
  station->snapshot->support.Fill(points_m, station->field_of_view.Edges(), &support);
}

void LiveScene::RefitAll() {
  if (std::exchange(is_warm_, true)) {
    // Frees the memory of the warm-up queues.
    if (snapshot_interval_ns_ < kLastRefitNs) {
      waiting_.ShrinkToFit();
      held_.ShrinkToFit();
    }
    snapshot_interval_ns_ = std::min(2 * snapshot_interval_ns_, kLastRefitNs);
    for (Station& station : scenes_) {
      if (station.snapshot) Refit(&station);
    }
  } else {
    for (Station& station : scenes_) {
      if (station.has_begun) Refit(&station);
    }
  }
  snapshot_ns_ = front_ns_;
  ++num_snapshots_;
}

TimeNs LiveScene::MakePlots(const IsTarget& is_target) {
  auto& [frame, bin] = waiting_.front();
  const TimeNs middle_ns = frame.info.middle_ns();
  MakePlotsOf(&frame, bin, is_target, &held_.Append());
  // The queue is never again as long as in the warm-up.
  if (num_warm_up_frames_ > 0) frame = LoadedFrame();
  waiting_.pop_front();
  if (num_warm_up_frames_ > 0 && --num_warm_up_frames_ == 0) AddLookahead();
  return middle_ns;
}

// Frames of the warm-up are judged by earlier and later frames, as in a recording.
void LiveScene::AddLookahead() {
  for (SceneFrame& frame : held_) {
    RemoveBodies(&frame);
    StationOf(frame.info.sensor)
        .clutter.AddLookahead(frame.info.sensor, SecondsOf(frame.info.middle_ns()), frame.plots);
  }
}

void LiveScene::MakePlotsOf(LoadedFrame* loaded, std::int64_t bin, const IsTarget& is_target,
                            SceneFrame* held) {
  Station& station = StationOf(loaded->info.sensor);
  std::swap(frame_.points_m, loaded->points_m);
  std::swap(frame_.times_ns, loaded->times_ns);
  frame_.frames.assign(1, loaded->info);
  frame_.frames[0].first_return = 0;
  frame_.frames[0].last_return = static_cast<std::uint32_t>(frame_.points_m.size());
  candidates_.clear();
  verdicts_.clear();
  const Occupancy::FloatsIn floats = [&](const Eigen::Vector3f& point_m) {
    return station.snapshot->support.IsFloating(point_m);
  };
  const double time_s = SecondsOf(loaded->info.middle_ns());
  const auto is_known_target = [&](const Eigen::Vector3f& point_m, std::int64_t dwell_begin_bin) {
    return is_target &&
           is_target(point_m + station.viewpoint_m, SecondsOfBin(dwell_begin_bin), time_s);
  };
  const Occupancy::IsTargetSince is_target_since = std::cref(is_known_target);  // no allocation
  for (std::uint32_t i = 0; i < frame_.points_m.size(); ++i) {
    const Eigen::Vector3f& point_m = frame_.points_m[i];
    verdicts_.push_back(
        station.occupancy.Judge(point_m, bin, num_snapshots_, floats, is_target_since));
    const Occupancy::Verdict& verdict = verdicts_.back();
    if (verdict.is_structure && !verdict.floats) continue;
    if (!station.snapshot->ground.IsGround(point_m)) candidates_.push_back(i);
  }
  FramePlots& found = plotter_.Find(frame_, 0, &candidates_, station.snapshot->ground,
                                    station.lowest_elevation_rad, config_.robust);
  held->info = frame_.frames[0];
  held->plots.clear();
  for (std::size_t p = 0; p < found.plots.size(); ++p) {
    LivePlot seen;
    seen.plot = found.plots[p];
    seen.stamp_ns = held->info.stamp_ns;
    Plot& plot = seen.plot;
    plot.frame = num_frames_;
    double rate = 0.0;
    std::optional<std::int64_t> dwell_begin_bin = bin;
    for (const std::uint32_t i : plotter_.ReturnsOf(p)) {
      const Eigen::Vector3d d = frame_.points_m[i].cast<double>() - plot.position_m;
      seen.scatter_m2 += d * d.transpose();
      rate += static_cast<double>(verdicts_[i].place_rate);
      dwell_begin_bin = std::min(
          dwell_begin_bin, verdicts_[i].dwell_begin_bin);  // nullopt compares less than any bin
    }
    plot.place_rate = std::max(rate / static_cast<double>(plot.num_returns),
                               station.occupancy.RateAround(plot.position_m.cast<float>(), bin));
    if (dwell_begin_bin) seen.dwell_begin_s = SecondsOfBin(*dwell_begin_bin);
    held->plots.push_back(seen);
  }
  ++num_frames_;
  for (const BodyBox& body : found.bodies) {
    Queue<BodyBox>& bodies = station.bodies;
    const auto at =
        std::upper_bound(bodies.begin(), bodies.end(), body.time_ns,
                         [](TimeNs time_ns, const BodyBox& box) { return time_ns < box.time_ns; });
    bodies.Insert(at, body);
  }
}

bool LiveScene::Next(TimeNs until_ns, SceneFrame* frame) {
  if (num_warm_up_frames_ > 0) return false;
  if (held_.empty() || held_.front().info.middle_ns() > until_ns) return false;
  std::swap(*frame, held_.front());
  held_.pop_front();
  Judge(frame);
  return true;
}

void LiveScene::RemoveBodies(SceneFrame* frame) {
  const Queue<BodyBox>& bodies = StationOf(frame->info.sensor).bodies;
  std::vector<LivePlot>& plots = frame->plots;
  plots.erase(std::remove_if(plots.begin(), plots.end(),
                             [&](const LivePlot& seen) { return IsNearBody(seen.plot, bodies); }),
              plots.end());
}

// True if the number of plots has risen so much that the clutter model no longer holds, as when
// rain begins. Search resumes after another warm-up.
bool LiveScene::IsSurge(const SceneFrame& frame) {
  if (rates_.size() <= frame.info.sensor) rates_.resize(frame.info.sensor + 1);
  PlotRate& rate = rates_[frame.info.sensor];
  const auto plots = static_cast<double>(frame.plots.size());
  ++rate.frames;
  rate.recent += (plots - rate.recent) / std::min(rate.frames, kRecentFrames);
  rate.typical += (plots - rate.typical) / std::min(rate.frames, kTypicalFrames);
  if (rate.recent < kSurgeFactor * rate.typical + kSurgePlots) return false;
  rate.typical = rate.recent;
  return true;
}

void LiveScene::Judge(SceneFrame* frame) {
  const TimeNs middle_ns = frame->info.middle_ns();
  Station& station = StationOf(frame->info.sensor);
  frame->time_s = SecondsOf(middle_ns);
  Queue<BodyBox>& bodies = station.bodies;
  const TimeNs oldest_ns = middle_ns - 2 * NsOf(kBodyMarginS);
  while (!bodies.empty() && bodies.front().time_ns < oldest_ns) bodies.pop_front();
  RemoveBodies(frame);
  if (IsSurge(*frame)) {
    station.clutter.Discount();
    station.search_from_ns = middle_ns + kWarmUpNs;
    learning_since_ns_ = middle_ns;
  }
  frame->is_searched = middle_ns >= station.search_from_ns;
  frame->observed_s = frame->time_s - SecondsOf(learning_since_ns_);
  // Frames of the warm-up are searched after it.
  if (frame->is_searched) {
    frame->observed_s = std::max(frame->observed_s, static_cast<double>(kWarmUpNs) * kSecondsPerNs);
  }
  station.clutter.AddFrame(frame->info.sensor, frame->time_s);
  station.clutter.Judge(station.snapshot->support, frame->time_s, &frame->plots);
  for (LivePlot& seen : frame->plots) {
    seen.time_s = frame->time_s;
    seen.plot.position_m += station.viewpoint_m.cast<double>();
  }
}

void LiveScene::RemoveFromClutter(const std::vector<LivePlot>& plots) {
  for (const LivePlot& seen : plots) {
    StationOf(seen.plot.sensor).clutter.RemoveFromClutter(seen.plot);
  }
}

void LiveScene::Sweep(double time_s) {
  for (Station& station : scenes_) {
    station.clutter.Sweep(time_s);
    station.occupancy.Sweep();
  }
}

}  // namespace unlidar
