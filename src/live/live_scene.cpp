#include "live/live_scene.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>

#include "base/algorithms.hpp"
#include "base/maths.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kFirstRefitNs = kWarmUpNs / 2;
constexpr TimeNs kLastRefitNs = 10'000'000'000;
// Averaging lengths in frames, and the factor, beyond kSwarmPlots, that means a change of weather.
constexpr int kRecentFrames = 5;
constexpr int kTypicalFrames = 100;
constexpr double kSurgeFactor = 2.0;

}  // namespace

LiveScene::LiveScene(const Config& config, bool is_traced)
    : config_(config), is_traced_(is_traced), snapshot_interval_ns_(kFirstRefitNs) {}

void LiveScene::AddSensor(std::uint32_t sensor, const SensorInfo& info) {
  const std::size_t station = stations_.Add(sensor, info);
  if (station < scenes_.size()) return;
  const RobustConfig& robust = config_.robust;
  scenes_.push_back({stations_.ViewpointM(station), StationScene(robust), ClutterModel(robust),
                     FloatingPlots(robust.background.place)});
}

// A pause between frames takes only as many bins as end no dwell.
std::int64_t LiveScene::BinOf(TimeNs time_ns) {
  const std::int64_t slot = (time_ns - begin_ns_) / kBinNs;
  if (slot > newest_slot_) {
    bin_shift_ += std::max<std::int64_t>(0, slot - newest_slot_ - kMaxPauseBins);
    newest_slot_ = slot;
  }
  return std::max<std::int64_t>(0, slot - bin_shift_);
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
  for (Eigen::Vector3f& point_m : frame->points_m) point_m -= station.viewpoint_m;
  station.scene.Learn(frame->points_m, bin, info.carrier, &voxels_);
  if (!is_warm_) {
    Enqueue(bin, frame);
    if (front_ns_ - begin_ns_ >= kWarmUpNs) WarmUp();
    return false;
  }
  if (!station.scene.is_fitted()) {
    if (front_ns_ - station.begin_ns >= kWarmUpNs) WarmUpLate(&station);
    return false;
  }
  Refit();
  Enqueue(bin, frame);
  return true;
}

// Many frames wait during the warm-up: of each only what its plots need is kept.
void LiveScene::Enqueue(std::int64_t bin, LoadedFrame* frame) {
  WaitingFrame& waiting = waiting_.Append();
  waiting.station = stations_.StationOf(frame->info.sensor);
  waiting.bin = bin;
  waiting.frame.frames.assign(1, frame->info);
  waiting.frame.frames[0].first_return = 0;
  waiting.frame.frames[0].last_return = static_cast<std::uint32_t>(frame->points_m.size());
  std::swap(waiting.frame.points_m, frame->points_m);
  std::swap(waiting.voxels, voxels_);
  TimeList& times_ns = waiting.frame.times_ns;
  times_ns.clear();
  times_ns.reserve(frame->times_ns.size());
  for (const TimeNs time_ns : frame->times_ns) times_ns.push_back(time_ns);
}

void LiveScene::WarmUp() {
  is_warm_ = true;
  snapshot_ns_ = front_ns_;
  num_warm_up_frames_ = waiting_.size();
  const bool is_complete = front_ns_ - begin_ns_ >= kWarmUpNs;
  for (Station& station : scenes_) {
    if (station.has_begun) station.scene.Fit();
    const bool began_first = station.begin_ns - begin_ns_ < kBinNs;
    if (is_complete && began_first) station.search_from_ns = station.begin_ns;
  }
}

// Warm-up of a station that is added while others are warm: frames before its warm-up ends are
// not searched, and those of another warm-up period are used for clutter only.
void LiveScene::WarmUpLate(Station* station) {
  station->search_from_ns = front_ns_ + kWarmUpNs;
  station->learning = Rejection::kWarmUp;
  learning_since_ns_ = station->begin_ns;
  station->scene.Fit();
}

// If a refit is due fits the grounds, and with the next frame the supports: together they would
// take one frame too long.
void LiveScene::Refit() {
  const bool are_grounds_new = std::exchange(are_grounds_new_, false);
  if (!are_grounds_new) {
    if (front_ns_ - snapshot_ns_ < snapshot_interval_ns_) return;
    // Frees the memory of the warm-up queues.
    if (snapshot_interval_ns_ < kLastRefitNs) {
      waiting_.ShrinkToFit();
      held_.ShrinkToFit();
    }
    snapshot_interval_ns_ = std::min(2 * snapshot_interval_ns_, kLastRefitNs);
    snapshot_ns_ = front_ns_;
    are_grounds_new_ = true;
  }
  for (Station& station : scenes_) {
    StationScene& scene = station.scene;
    if (!scene.is_fitted()) continue;
    are_grounds_new ? scene.FillSupport() : scene.FitGround();
  }
}

TimeNs LiveScene::MakePlots(const KnownTargets& targets) {
  WaitingFrame& frame = waiting_.front();
  const TimeNs middle_ns = frame.middle_ns();
  MakePlotsOf(&frame, targets, &held_.Append());
  // The queue is never again as long as in the warm-up.
  if (num_warm_up_frames_ > 0) frame = WaitingFrame();
  waiting_.pop_front();
  if (num_warm_up_frames_ > 0 && --num_warm_up_frames_ == 0) AddLookahead();
  return middle_ns;
}

// Frames of the warm-up are judged by earlier and later frames, as in a recording.
void LiveScene::AddLookahead() {
  for (SceneFrame& frame : held_) {
    RemoveBodies(&frame);
    Station& station = StationOf(frame.info.sensor);
    AddToClutter(frame, &station);
    ++station.num_lookahead_frames;
  }
}

void LiveScene::AddToClutter(const SceneFrame& frame, Station* station) {
  station->clutter.AddFrames(frame.info.sensor, frame.bin);
  for (const LivePlot& seen : frame.plots) station->clutter.Add(seen.plot, frame.bin);
}

void LiveScene::MakePlotsOf(WaitingFrame* waiting, const KnownTargets& targets, SceneFrame* held) {
  const std::int64_t bin = waiting->bin;
  Station& station = scenes_[waiting->station];
  Recording& frame = waiting->frame;
  const auto is_known_target = [&](const Eigen::Vector3f& point_m, std::int64_t dwell_begin_bin) {
    // Called for nearly every return of the first two minutes, so the cheap box is tested first.
    const Eigen::Vector3d place_m = (point_m + station.viewpoint_m).cast<double>();
    return targets.box_m.contains(place_m) &&
           targets.are_at(place_m, SecondsOfBin(dwell_begin_bin));
  };
  // By reference: a std::function would copy the lambda to the heap.
  FramePlots& found =
      station.scene.FindPlots(bin, waiting->voxels, std::cref(is_known_target), &frame);
  held->info = frame.frames[0];
  held->bin = static_cast<std::uint32_t>(bin);
  held->plots.clear();
  held->bodies_m.clear();
  if (is_traced_) {
    const Eigen::Vector3f viewpoint_m = station.viewpoint_m + held->info.carrier.shift_m;
    for (const std::uint32_t i : found.body_returns) {
      held->bodies_m.push_back(frame.points_m[i] + viewpoint_m);
    }
  }
  for (std::size_t p = 0; p < found.plots.size(); ++p) {
    LivePlot seen;
    seen.plot = found.plots[p];
    seen.stamp_ns = held->info.stamp_ns;
    seen.plot.frame = num_frames_;
    seen.bin = held->bin;
    // In rain a stream knows a place for too short a time: its surroundings say more.
    if (seen.plot.stray_group_rate == 0.0F) {
      seen.plot.place_rate = station.scene.occupancy().RateAround(
          seen.plot.position_m.cast<float>(), bin, seen.plot.place_rate);
    }
    const Eigen::Matrix3d to_ray_axes = RayAxes(seen.plot.ray_m).transpose();
    Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();
    std::optional<std::int32_t> dwell_begin_bin = static_cast<std::int32_t>(bin);  // none is least
    for (const std::uint32_t i : station.scene.ReturnsOf(p)) {
      const Eigen::Vector3d d = frame.points_m[i].cast<double>() - seen.plot.ray_m;
      scatter_m2 += d * d.transpose();
      seen.facing_sums.Add(to_ray_axes * d);
      const double after_s = SecondsOf(frame.times_ns[i] - seen.plot.time_ns);
      seen.time_covariance_ms += (after_s * d).cast<float>();
      seen.time_scatter_s2 += static_cast<float>(after_s * after_s);
      dwell_begin_bin = std::min(dwell_begin_bin, station.scene.verdicts()[i].dwell_begin_bin);
    }
    seen.scatter_m2 = SymmetricMatrix(scatter_m2);
    if (dwell_begin_bin) seen.dwell_begin_s = SecondsOfBin(*dwell_begin_bin);
    held->plots.push_back(seen);
  }
  ++num_frames_;
  held->bodies.clear();
  for (const BodyBox& body : found.bodies) {
    InsertInOrder(body, &station.bodies);
    held->bodies.push_back(body.Moved(station.viewpoint_m));
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
  const Station& station = StationOf(frame->info.sensor);
  EraseIf(&frame->plots, [&](const LivePlot& seen) {
    if (!IsNearBody(seen.plot, station.bodies)) return false;
    if (is_traced_) {
      frame->bodies_m.push_back(seen.plot.position_m.cast<float>() + station.viewpoint_m);
    }
    return true;
  });
}

// True if the number of plots has risen so far above all that the window has known that the clutter
// model no longer holds, as when rain begins. Search resumes after another warm-up.
bool LiveScene::IsSurge(const SceneFrame& frame) {
  if (rates_.size() <= frame.info.sensor) rates_.resize(frame.info.sensor + 1);
  PlotRate& rate = rates_[frame.info.sensor];
  const auto plots = static_cast<double>(frame.plots.size());
  ++rate.frames;
  rate.recent += (plots - rate.recent) / std::min(rate.frames, kRecentFrames);
  rate.typical += (plots - rate.typical) / std::min(rate.frames, kTypicalFrames);
  const double passed_s = std::max(0.0, frame.time_s - std::exchange(rate.time_s, frame.time_s));
  rate.known = std::max(rate.typical, std::exp(-passed_s / config_.live.window_s) * rate.known);
  if (rate.recent < kSurgeFactor * rate.known + kSwarmPlots) return false;
  rate.typical = rate.recent;
  return true;
}

void LiveScene::Judge(SceneFrame* frame) {
  const TimeNs middle_ns = frame->info.middle_ns();
  Station& station = StationOf(frame->info.sensor);
  frame->time_s = SecondsSinceBegin(middle_ns);
  frame->viewpoint_m = (station.viewpoint_m + frame->info.carrier.shift_m).cast<double>();
  Queue<BodyBox>& bodies = station.bodies;
  const TimeNs oldest_ns = middle_ns - 2 * NsOf(kBodyMarginS);
  while (!bodies.empty() && bodies.front().time_ns < oldest_ns) bodies.pop_front();
  RemoveBodies(frame);
  if (IsSurge(*frame) && config_.robust.Uses(Rule::kSurge)) {
    if (std::isfinite(config_.live.window_s)) {
      station.clutter.Forget(frame->info.sensor, frame->bin);
    }
    station.search_from_ns = middle_ns + kWarmUpNs;
    station.learning = Rejection::kSurge;
    learning_since_ns_ = middle_ns;
  }
  frame->rejection = middle_ns >= station.search_from_ns ? Rejection::kNone : station.learning;
  frame->observed_s = frame->time_s - SecondsSinceBegin(learning_since_ns_);
  // Frames of the warm-up are searched after it.
  if (frame->is_searched()) {
    frame->observed_s = std::max(frame->observed_s, SecondsOf(kWarmUpNs));
  }
  JudgePlots(frame, &station);
  for (LivePlot& seen : frame->plots) {
    seen.time_s = frame->time_s;
    seen.plot.position_m += station.viewpoint_m.cast<double>();
  }
}

// Adds the plots to the clutter, marks those that float and sets their clutter intensities.
void LiveScene::JudgePlots(SceneFrame* frame, Station* station) {
  if (station->num_lookahead_frames > 0) {
    --station->num_lookahead_frames;
  } else {
    AddToClutter(*frame, station);
  }
  const std::uint32_t bin = frame->bin;
  const ClutterModel& clutter = station->clutter;
  const Support& support = station->scene.support();
  const std::uint32_t num_recent_frames =
      clutter.NumFrames(frame->info.sensor, FloatingPlots::RecentBins(bin));
  const bool is_squall = clutter.IsSquall(frame->info.sensor, bin);
  for (LivePlot& seen : frame->plots) {
    station->floating.Add(support, bin, num_recent_frames, &seen.plot);
    // The support may be hidden by fog.
    if (is_blinded_) seen.plot.is_floating = false;
    const ClutterModel::Intensity intensity = clutter.IntensityOf(seen.plot, bin, is_squall);
    seen.log_surrounding_clutter = intensity.log_surrounding;
    seen.plot.log_clutter = intensity.log_clutter;
  }
}

void LiveScene::RemoveFromClutter(const std::vector<LivePlot>& plots) {
  for (const LivePlot& seen : plots) {
    StationOf(seen.plot.sensor).clutter.Remove(seen.plot, seen.bin);
  }
}

void LiveScene::Sweep(std::uint32_t newest_bin) {
  const double window_bins = config_.live.window_s / kBinS;
  for (Station& station : scenes_) {
    if (newest_bin > window_bins) {
      const std::uint32_t before_bin = newest_bin - static_cast<std::uint32_t>(window_bins);
      station.clutter.Forget(before_bin);
      station.floating.Forget(before_bin);
    }
    station.scene.Sweep();
  }
}

}  // namespace unlidar
