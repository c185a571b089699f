#include "live/live_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "robust/tracking/flight.hpp"
#include "trajectory/sampling.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kWarmUpNs = 3'000'000'000;
constexpr TimeNs kFirstRefitNs = 1'500'000'000;
constexpr TimeNs kLastRefitNs = 10'000'000'000;
constexpr double kRatesFadeS = 60.0;
constexpr double kPauseS = 1.0;  // without a plot: what is before and after may be two things
constexpr RangeRadius kLeastMove{0.8, 0.02};
constexpr double kLongStandS = 2.0;
constexpr double kTidyS = 2.0;
constexpr double kKeepPathsS = 30.0;  // a path that is not confirmed by then has no older part
constexpr double kAheadS = 0.1;     // rows are given so much earlier than they are due, if need be
constexpr double kTogetherS = 0.0;  // and so many at once
// What the clutter of a place is, is hardly known at first: paths of it are more frequent then than
// its mean rate says, for where one plot was unexpected so is the next.
constexpr double kUnknownLog = 8.0;
constexpr double kLearningS = 10.0;
constexpr double kBodyHoldS = 0.1;  // plots wait so long for a body that may show beside them
constexpr double kTaken = 0.0;      // gain from which a plot is a track's
constexpr std::size_t kElevationReturns = 100'000;
constexpr std::int64_t kMaxPauseBins = 5;
constexpr std::size_t kEarlyFramesAtOnce = 3;  // that wait since the begin, with each new one

TimeNs Ns(double seconds) { return std::llround(seconds / kSecondsPerNs); }

// A stream does not know how often a place will be hit later on: a twig that is hit more often for
// a while looks like something new. What neither moves nor floats may be one.
bool MovesOrFloats(const std::vector<SeenPlot>& path) {
  const std::size_t third = std::max<std::size_t>(1, path.size() / 3);
  Eigen::Vector3d begin_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d end_m = Eigen::Vector3d::Zero();
  std::size_t num_floating = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Plot& plot = path[i].plot;
    if (i < third) begin_m += plot.position_m / static_cast<double>(third);
    if (i >= path.size() - third) end_m += plot.position_m / static_cast<double>(third);
    num_floating += plot.is_floating ? 1U : 0U;
  }
  const double least_m = kLeastMove.At(path.front().ray_m.norm());
  return 2 * num_floating >= path.size() || (end_m - begin_m).norm() > least_m;
}

// How many plots at the begin of a path stand still for long without floating: what flies off from
// there is another thing than what stands there.
std::size_t StandingPrefix(const std::vector<SeenPlot>& path) {
  const double least_m = kLeastMove.At(path.front().ray_m.norm());
  Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
  std::size_t count = 0;
  std::size_t num_floating = 0;
  for (const SeenPlot& seen : path) {
    const Eigen::Vector3d& at_m = seen.plot.position_m;
    if (count > 0 && (at_m - sum_m / static_cast<double>(count)).norm() > least_m) break;
    sum_m += at_m;
    num_floating += seen.plot.is_floating ? 1U : 0U;
    ++count;
  }
  const bool is_long = path[count - 1].at.time_s - path.front().at.time_s > kLongStandS;
  return is_long && 2 * num_floating < count && count < path.size() ? count : 0;
}

}  // namespace

SceneSnapshot::SceneSnapshot(std::vector<Eigen::Vector3f> points_m, const ElevationRange& view,
                             const RobustConfig& config)
    : structure_m(std::move(points_m)),
      ground(structure_m, config.ground),
      support(structure_m, ground, view, config.background.occluder_cell_deg, config.support) {}

LiveTracker::Station::Station(const Eigen::Vector3f& its_viewpoint_m, const Config& config)
    : viewpoint_m(its_viewpoint_m),
      occupancy(config.robust.background),
      clutter(config.robust, config.live.window_s) {}

LiveTracker::LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event)
    : config_(config),
      output_times_(std::move(output_times)),
      on_event_(std::move(on_event)),
      bin_ns_(Ns(config.robust.background.bin_s)),
      snapshot_interval_ns_(kFirstRefitNs) {}

LiveTracker::~LiveTracker() = default;

void LiveTracker::SetSensor(std::uint32_t sensor, const SensorInfo& info) {
  if (recent_.sensors.size() <= sensor) {
    recent_.sensors.resize(sensor + 1);
    watch_.sensors.resize(sensor + 1);
    moment_.frames_before.resize(sensor + 1, 0);
  }
  recent_.sensors[sensor] = info;
  const std::size_t station = stations_.Add(sensor, info.origin_m);
  if (station == scenes_.size()) scenes_.emplace_back(stations_.ViewpointM(station), config_);
  watch_.sensors[sensor].viewpoint_m = stations_.ViewpointM(station).cast<double>();
  watch_.sensors[sensor].frame_s = static_cast<double>(info.frame_period_ns) * kSecondsPerNs;
  const TrackerConfig& tracker = config_.robust.tracker;
  models_.clear();
  for (const double sigma : tracker.sigma_a_mps2) models_.emplace_back(sigma, watch_, tracker);
  for (std::size_t m = 0; m < models_.size(); ++m) {
    if (searches_.size() <= m) {
      searches_.emplace_back(plots_, log_births_, free_, models_[m], tracker);
    }
    searches_[m].SetModel(models_[m]);
  }
}

double LiveTracker::SecondsOf(TimeNs time_ns) const {
  return static_cast<double>(time_ns - begin_ns_) * kSecondsPerNs;
}

// A pause between frames takes no more bins than it needs to end every stay.
std::int64_t LiveTracker::BinOf(TimeNs time_ns) {
  const std::int64_t slot = (time_ns - begin_ns_) / bin_ns_;
  if (slot > newest_slot_) {
    bin_shift_ += std::max<std::int64_t>(0, slot - newest_slot_ - kMaxPauseBins);
    newest_slot_ = slot;
  }
  return std::max<std::int64_t>(0, slot - bin_shift_);
}

void LiveTracker::Take(LoadedFrame frame) {
  const TimeNs middle_ns = frame.info.middle_ns();
  if (!std::exchange(has_begun_, true)) {
    begin_ns_ = frame.info.begin_ns;
    front_ns_ = stepped_ns_ = middle_ns;
  }
  AddInstants(frame.info);
  const std::int64_t bin = BinOf(middle_ns);
  Station& station = StationOf(frame.info);
  if (!std::exchange(station.has_begun, true)) {
    station.begin_ns = frame.info.begin_ns;
    station.search_from_ns = station.begin_ns + kWarmUpNs;
    learning_since_ns_ = station.begin_ns;
  }
  for (Eigen::Vector3f& point_m : frame.points_m) point_m -= station.viewpoint_m;
  station.occupancy.AddFrame(bin);
  for (const Eigen::Vector3f& point_m : frame.points_m) {
    station.occupancy.Add(point_m, bin);
    station.view.Add(point_m);
  }
  front_ns_ = std::max(front_ns_, middle_ns);
  if (!station.snapshot) {
    for (const Eigen::Vector3f& point_m : frame.points_m) {
      if (station.early_returns_m.size() < kElevationReturns) {
        station.early_returns_m.push_back(point_m);
      }
    }
  }
  if (!is_warm()) {
    early_.emplace_back(std::move(frame), bin);
    if (front_ns_ - begin_ns_ >= kWarmUpNs) WarmUp();
    return;
  }
  if (!station.snapshot) {
    WarmUpLate(std::move(frame), bin, &station);
    return;
  }
  if (front_ns_ - snapshot_ns_ >= snapshot_interval_ns_) RefitScene();
  early_.emplace_back(std::move(frame), bin);
  MakeEarlyPlots(kEarlyFramesAtOnce);
}

LiveTracker::Station& LiveTracker::StationOf(const FrameInfo& frame) {
  return scenes_[stations_.StationOf(frame.sensor)];
}

void LiveTracker::Learn(const LoadedFrame& frame, std::int64_t bin, Station* station) {
  for (const Eigen::Vector3f& point_m : frame.points_m) {
    station->occupancy.Judge(point_m, bin, 0, [](const Eigen::Vector3f&) { return false; });
  }
}

// What was kept until the scene is known a little.
void LiveTracker::WarmUp() {
  for (const auto& [frame, bin] : early_) Learn(frame, bin, &StationOf(frame.info));
  RefitScene();
}

// A station that is first heard when others are warm is as ignorant as they were: what it sees
// until it is warm, too, is left out, and what it sees then for as long only tells of clutter.
void LiveTracker::WarmUpLate(LoadedFrame frame, std::int64_t bin, Station* station) {
  station->early.emplace_back(std::move(frame), bin);
  if (front_ns_ - station->begin_ns < kWarmUpNs) return;
  for (const auto& [early_frame, early_bin] : std::exchange(station->early, {})) {
    Learn(early_frame, early_bin, station);
  }
  station->search_from_ns = front_ns_ + kWarmUpNs;
  learning_since_ns_ = station->begin_ns;
  Refit(station);
}

void LiveTracker::MakeEarlyPlots(std::size_t most) {
  for (; !early_.empty() && most > 0; --most) {
    auto [frame, bin] = std::move(early_.front());
    early_.pop_front();
    const TimeNs middle_ns = frame.info.middle_ns();
    MakePlots(std::move(frame), bin);
    StepHeld(middle_ns - Ns(kBodyHoldS));
  }
}

void LiveTracker::Refit(Station* station) {
  if (!station->early_returns_m.empty()) {
    station->lowest_elevation_rad = LowestElevationRad(std::exchange(station->early_returns_m, {}));
  }
  station->snapshot = std::make_unique<SceneSnapshot>(station->occupancy.Structure(),
                                                      station->view.Edges(), config_.robust);
}

void LiveTracker::RefitScene() {
  if (std::exchange(is_warm_, true)) {
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

void LiveTracker::MakePlots(LoadedFrame loaded, std::int64_t bin) {
  Station& station = StationOf(loaded.info);
  Recording frame;
  frame.points_m = std::move(loaded.points_m);
  frame.times_ns = std::move(loaded.times_ns);
  frame.frames = {loaded.info};
  frame.frames[0].first_return = 0;
  frame.frames[0].last_return = static_cast<std::uint32_t>(frame.points_m.size());
  std::vector<std::uint32_t> candidates;
  std::vector<float> rates(frame.points_m.size(), 0.0F);
  const Occupancy::FloatsIn floats = [&](const Eigen::Vector3f& point_m) {
    return station.snapshot->support.IsFloating(point_m);
  };
  for (std::uint32_t i = 0; i < frame.points_m.size(); ++i) {
    const Eigen::Vector3f& point_m = frame.points_m[i];
    const Occupancy::Verdict verdict =
        station.occupancy.Judge(point_m, bin, num_snapshots_, floats);
    rates[i] = verdict.place_rate;
    if (verdict.is_structure && !verdict.floats) continue;
    if (!station.snapshot->ground.Holds(point_m)) candidates.push_back(i);
  }
  FramePlots found = PlotsOfFrame(frame, 0, std::move(candidates), station.snapshot->ground,
                                  station.lowest_elevation_rad, config_.robust.plots);
  HeldFrame held;
  held.info = frame.frames[0];
  for (Plot& plot : found.plots) {
    plot.frame = num_frames_;
    SeenPlot seen;
    seen.stamp_ns = held.info.stamp_ns;
    double rate = 0.0;
    for (const std::uint32_t i : plot.returns) {
      const Eigen::Vector3d d = frame.points_m[i].cast<double>() - plot.position_m;
      seen.scatter_m2 += d * d.transpose();
      rate += static_cast<double>(rates[i]);
    }
    held.place_rates.push_back(rate / static_cast<double>(plot.returns.size()));
    seen.plot = std::move(plot);
    held.plots.push_back(std::move(seen));
  }
  ++num_frames_;
  for (const BodyBox& body : found.bodies) {
    std::deque<BodyBox>& bodies = station.bodies;
    const auto at =
        std::upper_bound(bodies.begin(), bodies.end(), body.time_ns,
                         [](TimeNs time_ns, const BodyBox& box) { return time_ns < box.time_ns; });
    bodies.insert(at, body);
  }
  held_.push_back(std::move(held));
}

void LiveTracker::StepHeld(TimeNs until_ns) {
  while (!held_.empty() && held_.front().info.middle_ns() <= until_ns) {
    HeldFrame held = std::move(held_.front());
    held_.pop_front();
    Step(std::move(held));
  }
}

void LiveTracker::Step(HeldFrame held) {
  const TimeNs middle_ns = held.info.middle_ns();
  const double time_s = SecondsOf(middle_ns);
  const TimeNs margin_ns = Ns(config_.robust.plots.body_margin_s);
  stepped_ns_ = std::max(stepped_ns_, middle_ns);
  Station& station = StationOf(held.info);
  while (!station.bodies.empty() && station.bodies.front().time_ns < middle_ns - 2 * margin_ns) {
    station.bodies.pop_front();
  }
  moment_.time_s = time_s;
  recent_.frames.push_back(held.info);
  station.clutter.AddFrame(held.info.sensor, time_s);

  std::vector<Plot> plots;
  for (const SeenPlot& seen : held.plots) plots.push_back(seen.plot);
  const std::vector<BodyBox> bodies(station.bodies.begin(), station.bodies.end());
  std::vector<Plot> left = plots;
  DropNearBodies(bodies, config_.robust.plots, &left);
  std::vector<SeenPlot> seen;
  std::vector<double> place_rates;
  for (std::size_t i = 0, k = 0; i < plots.size() && k < left.size(); ++i) {
    if (plots[i].position_m != left[k].position_m) continue;
    ++k;
    seen.push_back(std::move(held.plots[i]));
    seen.back().at = moment_;
    place_rates.push_back(held.place_rates[i]);
  }
  station.clutter.Judge(station.snapshot->support, place_rates, time_s, &left);
  const TrackerConfig& tracker = config_.robust.tracker;
  const double fade = std::exp(-std::max(0.0, time_s - rates_s_) / kRatesFadeS);
  watched_s_ = watched_s_ * fade + std::max(0.0, time_s - rates_s_);
  odds_ *= fade;
  num_plots_ *= fade;
  rates_s_ = std::max(rates_s_, time_s);
  std::vector<double> odds;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    seen[i].ray_m = seen[i].plot.position_m;
    seen[i].plot.position_m += station.viewpoint_m.cast<double>();
    seen[i].plot.log_clutter = left[i].log_clutter;
    seen[i].plot.is_floating = left[i].is_floating;
    odds.push_back(std::exp(LogBirthOdds(seen[i].plot, watch_, tracker)));
    odds_ += odds.back();
    num_plots_ += 1.0;
  }

  // Each plot is that of one track at most, of the one that it suits best; what no track explains
  // better than clutter may be another target's.
  std::vector<char> is_free(seen.size(), 1);
  std::vector<double> best_gain(seen.size(), -1e9);
  std::vector<std::size_t> best_track(seen.size(), 0);
  for (std::size_t t = 0; t < outputs_.size(); ++t) {
    const std::vector<double> gains = outputs_[t].track->GainsOf(seen, moment_);
    for (std::size_t i = 0; i < seen.size(); ++i) {
      if (gains[i] <= best_gain[i]) continue;
      best_gain[i] = gains[i];
      best_track[i] = t;
    }
  }
  for (std::size_t t = 0; t < outputs_.size(); ++t) {
    std::vector<char> is_allowed(seen.size());
    for (std::size_t i = 0; i < seen.size(); ++i) {
      is_allowed[i] = best_track[i] == t || best_gain[i] <= kTaken;
    }
    outputs_[t].track->Extend(seen, is_allowed, moment_);
  }
  for (std::size_t i = 0; i < seen.size(); ++i) is_free[i] = best_gain[i] <= kTaken;

  // Before it is warm, nobody knows what clutter is: what was seen until then only tells.
  if (!seen.empty() && middle_ns >= station.search_from_ns) {
    const std::size_t first = plots_.size();
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const double even = tracker.even_birth_share;
      log_births_.push_back(std::log(even + (1.0 - even) * odds[i] * num_plots_ / odds_));
      plots_.push_back(seen[i].plot);
      seen_.push_back(std::move(seen[i]));
      free_.push_back(is_free[i]);
    }
    const Slice slice = SliceOf(plots_, log_births_, first, moment_, tracker);
    for (TrackSearch& search : searches_) search.Extend(slice);
    Confirm();
  }
  ++moment_.frames_before[held.info.sensor];

  for (std::size_t t = 0; t < outputs_.size();) {
    Output& output = outputs_[t];
    const TimeNs last_ns = output.track->last_evidence_ns();
    if (middle_ns - last_ns <= Ns(tracker.max_gap_s)) {
      ++t;
      continue;
    }
    GiveRowsOf(&output, stepped_ns_, stepped_ns_);
    on_event_(TrackEnded{output.track->id(), last_ns, output.kind.kind()});
    outputs_.erase(outputs_.begin() + static_cast<std::ptrdiff_t>(t));
  }
  if (time_s - tidied_s_ >= kTidyS) Tidy(time_s);
}

// Clutter alone makes a path of this score so many times an hour, as every plot may be the first of
// one, with every model.
void LiveTracker::Confirm() {
  const TrackerConfig& tracker = config_.robust.tracker;
  const double plots_per_hour = 3600.0 * num_plots_ / std::max(watched_s_, 1.0);
  const auto num_models = static_cast<double>(models_.size() * tracker.birth_speeds_mps.size());
  const double threshold =
      std::log(plots_per_hour * num_models / config_.live.false_alarms_per_hour) +
      kUnknownLog * std::exp(-(moment_.time_s - SecondsOf(learning_since_ns_)) / kLearningS);
  std::vector<Path> paths;
  for (const TrackSearch& search : searches_) {
    for (Path& path : search.PathsToLastSlice(threshold)) paths.push_back(std::move(path));
  }
  std::sort(paths.begin(), paths.end(), [](const Path& a, const Path& b) {
    return a.score > b.score || (a.score == b.score && a.plots < b.plots);
  });
  for (const Path& path : paths) {
    const bool is_taken = std::any_of(path.plots.begin(), path.plots.end(),
                                      [&](std::uint32_t i) { return !free_[i]; });
    if (!is_taken) ConfirmPath(path, threshold);
  }
}

// A track begins with what flies of a path: that may have come from something on the ground.
void LiveTracker::ConfirmPath(const Path& path, double threshold) {
  std::vector<SeenPlot> seen;
  for (const std::uint32_t i : path.plots) seen.push_back(seen_[i]);
  std::size_t first = 0;
  for (std::size_t begin = 0; begin < seen.size();) {
    std::size_t end = begin + 1;
    while (end < seen.size() && seen[end].at.time_s - seen[end - 1].at.time_s < kPauseS) ++end;
    const auto low = std::count_if(
        seen.begin() + static_cast<std::ptrdiff_t>(begin),
        seen.begin() + static_cast<std::ptrdiff_t>(end),
        [&](const SeenPlot& at) { return at.plot.lowest_m <= config_.robust.off_ground_m; });
    if (2 * static_cast<std::size_t>(low) > end - begin) first = end;
    begin = end;
  }
  seen.erase(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(first));
  if (seen.empty()) return;
  const std::size_t standing = StandingPrefix(seen);
  seen.erase(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(standing));
  first += standing;
  std::vector<Plot> members;
  members.reserve(seen.size());
  for (const SeenPlot& at : seen) members.push_back(at.plot);
  if (!IsFlight(recent_, watch_, members, config_.robust) || !MovesOrFloats(seen)) return;
  // A drone that shows as two plots in a frame is no second one.
  const bool is_known = std::any_of(outputs_.begin(), outputs_.end(), [&](const Output& other) {
    const auto near = std::count_if(seen.begin(), seen.end(), [&](const SeenPlot& at) {
      return other.track->IsNear(at.plot.position_m, at.at.time_s);
    });
    return 2 * static_cast<std::size_t>(near) >= seen.size();
  });
  auto track = std::make_unique<TrackFollower>(next_id_, seen, log_births_[path.plots[first]],
                                               models_, config_.robust.tracker,
                                               config_.robust.collect, config_.trajectory);
  if (track->score() < threshold) return;
  for (const std::uint32_t i : path.plots) free_[i] = 0;
  for (TrackSearch& search : searches_) search.DropTaken();
  if (is_known) return;
  ++next_id_;
  outputs_.emplace_back();
  outputs_.back().track = std::move(track);
}

void LiveTracker::Tidy(double time_s) {
  tidied_s_ = time_s;
  const TimeNs oldest_ns = begin_ns_ + Ns(time_s - kKeepPathsS);
  const auto first = std::find_if(plots_.begin(), plots_.end(), [&](const Plot& plot) {
    return plot.frame_time_ns >= oldest_ns;
  });
  const std::ptrdiff_t gone = first - plots_.begin();
  for (TrackSearch& search : searches_) search.Forget(static_cast<std::size_t>(gone));
  plots_.erase(plots_.begin(), plots_.begin() + gone);
  seen_.erase(seen_.begin(), seen_.begin() + gone);
  log_births_.erase(log_births_.begin(), log_births_.begin() + gone);
  free_.erase(free_.begin(), free_.begin() + gone);
  const auto frame =
      std::find_if(recent_.frames.begin(), recent_.frames.end(),
                   [&](const FrameInfo& info) { return info.begin_ns >= oldest_ns; });
  recent_.frames.erase(recent_.frames.begin(), frame);
  for (Station& station : scenes_) {
    station.clutter.Sweep(time_s);
    station.occupancy.Sweep();
  }
  TimeNs given_ns = stepped_ns_ - Ns(kKeepPathsS);
  for (const Output& output : outputs_) {
    if (output.is_told) given_ns = std::min(given_ns, output.given_ns);
  }
  while (instants_.size() > 2 && instants_[1] < given_ns) instants_.pop_front();
}

void LiveTracker::AddInstants(const FrameInfo& frame) {
  if (std::holds_alternative<FirstSensorStamps>(output_times_)) {
    if (frame.sensor == 0) instants_.push_back(frame.stamp_ns);
    return;
  }
  if (const auto* rate = std::get_if<Rate>(&output_times_)) {
    if (!rate_instants_) rate_instants_.emplace(*rate, begin_ns_, begin_ns_);
    for (; (*rate_instants_)[next_instant_] <= frame.end_ns; ++next_instant_) {
      instants_.push_back((*rate_instants_)[next_instant_]);
    }
    return;
  }
  const auto& list = std::get<std::vector<TimeNs>>(output_times_);
  for (; next_instant_ < list.size() && list[next_instant_] <= frame.end_ns; ++next_instant_) {
    instants_.push_back(list[next_instant_]);
  }
}

int LiveTracker::SupportAt(const TrackFollower& track, std::size_t i) const {
  const TimeNs at_ns = instants_[i];
  const TimeNs from_ns = i > 0 ? at_ns - (at_ns - instants_[i - 1]) / 2 : at_ns;
  const TimeNs to_ns =
      i + 1 < instants_.size() ? at_ns + (instants_[i + 1] - at_ns) / 2 : at_ns + (at_ns - from_ns);
  return track.ReturnsBetween(from_ns, to_ns);
}

void LiveTracker::GiveRows(TimeNs newest_ns) {
  const TimeNs due_ns = newest_ns - Ns(config_.live.delay_s - kAheadS);
  for (Output& output : outputs_) {
    GiveRowsOf(&output, std::min(due_ns, stepped_ns_), newest_ns);
  }
}

void LiveTracker::GiveRowsOf(Output* output, TimeNs limit_ns, TimeNs newest_ns) {
  TrackFollower& track = *output->track;
  const auto next =
      std::upper_bound(instants_.begin(), instants_.end(),
                       output->is_told ? output->given_ns : std::numeric_limits<TimeNs>::min());
  const auto end = std::upper_bound(next, instants_.end(), limit_ns);
  // Several at once cost no more than one.
  if (next == end ||
      (output->is_told && newest_ns != limit_ns && *next > limit_ns - Ns(kTogetherS))) {
    return;
  }
  track.Fit();
  output->kind.Observe(track.trajectory(), limit_ns);
  const Kind kind = output->kind.kind();
  const TimeNs period_ns = ShortestPeriodNs(recent_);
  const double probability = config_.trajectory.silence_probability;
  const TimeNs half_ns = period_ns / 2;
  TimeInterval interval;
  interval.begin_ns = output->is_told
                          ? output->given_ns + 1
                          : track.measurements().front().time_ns - half_ns -
                                SilenceBeforeNs(track.measurements(), period_ns, probability);
  interval.end_ns =
      std::min(limit_ns, track.last_evidence_ns() + half_ns +
                             SilenceAfterNs(track.measurements(), period_ns, probability));
  if (!std::exchange(output->is_told, true)) {
    output->given_ns = interval.begin_ns - 1;
    on_event_(TrackConfirmed{track.id(), track.first_evidence_ns(), kind});
  }
  RowSource source;
  source.track_id = track.id();
  source.trajectory = track.trajectory();
  source.presence = interval;
  source.depth_sigma_m = track.depth_sigma_m();
  source.sights = SightsOf(track.measurements());
  source.max_sigma_m = config_.trajectory.max_sigma_m;
  const OutputInstants instants(std::vector<TimeNs>(next, end));
  const RowStream rows = SampleRows(source, instants);
  const TimeNs late_ns = newest_ns - Ns(config_.live.delay_s);
  while (std::optional<TrajectoryRow> row = rows()) {
    const auto at = std::lower_bound(instants_.begin(), instants_.end(), row->time_ns);
    row->support = SupportAt(track, static_cast<std::size_t>(at - instants_.begin()));
    on_event_(RowGiven{*row, row->time_ns < late_ns, kind});
    output->given_ns = row->time_ns;
  }
  for (const SeenPlot& seen : track.Settle(SecondsOf(output->given_ns))) {
    scenes_[stations_.StationOf(seen.plot.sensor)].clutter.Explain(seen.plot.frame, seen.ray_m);
  }
}

void LiveTracker::Advance(TimeNs settled_ns, TimeNs now_ns) {
  if (!is_warm()) return;
  MakeEarlyPlots(kEarlyFramesAtOnce);
  if (early_.empty()) StepHeld(settled_ns - Ns(kBodyHoldS));
  GiveRows(now_ns);
}

void LiveTracker::Close(TimeNs newest_ns) {
  if (!has_begun_) return;
  if (!is_warm()) WarmUp();
  MakeEarlyPlots(early_.size());
  StepHeld(std::numeric_limits<TimeNs>::max());
  for (Output& output : outputs_) {
    GiveRowsOf(&output, std::numeric_limits<TimeNs>::max() / 2, newest_ns);
    on_event_(TrackEnded{output.track->id(), output.track->last_evidence_ns(), output.kind.kind()});
  }
  outputs_.clear();
}

}  // namespace unlidar
