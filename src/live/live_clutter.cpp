#include "live/live_clutter.hpp"

#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

constexpr double kDiscountWindows = 3.0;     // exp(-3): leaves a twentieth of every count
constexpr double kSurroundingsFactor = 3.0;  // radius of the surroundings over that of a place
constexpr double kMinStaticCount = 3.0;
constexpr double kNeighbourSlope = 0.01;
constexpr double kOuterReachFactor = 5.0;  // radius of the outer region over the reach
constexpr double kSimultaneousS = 0.6;     // before the plot
constexpr double kRecentS = 3.0;
constexpr double kPersistentShare = 0.2;  // of the frames of its sensor with a plot there

RangeRadius Surroundings(const RangeRadius& radius) {
  return {kSurroundingsFactor * radius.constant_m, kSurroundingsFactor * radius.slope};
}

}  // namespace

LiveClutter::LiveClutter(const RobustConfig& config, double fade_s)
    : exclusion_s_((kClutterExclusionBins + 0.5) * config.background.bin_s),
      fade_s_(fade_s),
      place_(config.background.place),
      static_grid_(config.background.place, fade_s),
      surroundings_(Surroundings(config.background.place), fade_s),
      floating_({kObjectRadiusM, kNeighbourSlope}, fade_s),
      self_({kObjectRadiusM, kNeighbourSlope}, fade_s),
      neighbours_({kObjectRadiusM, kNeighbourSlope}, fade_s),
      outer_({kObjectRadiusM, kNeighbourSlope}, fade_s) {}

LiveClutter::Sensor& LiveClutter::SensorAt(std::uint32_t sensor) {
  while (sensors_.size() <= sensor) {
    sensors_.push_back({FadingGrid(kClutterWide, fade_s_), FadingGrid(kClutterMiddle, fade_s_),
                        FadingGrid(kClutterNarrow, fade_s_), FadingGrid(kSpotRadius, fade_s_),
                        FadingGrid(place_, kRecentS)});
  }
  return sensors_[sensor];
}

void LiveClutter::AddLookahead(std::uint32_t sensor, double time_s,
                               const std::vector<LivePlot>& plots) {
  Sensor& seen = SensorAt(sensor);
  if (lookahead_end_s_ < 0.0) lookahead_begin_s_ = time_s;
  lookahead_end_s_ = time_s;
  seen.lookahead_s.push_back(time_s);
  seen.lookahead_frames += 1.0;
  for (const LivePlot& plot : plots) {
    const Eigen::Vector3f place_m = plot.plot.ray_m.cast<float>();
    const Recent recent{time_s, plot.plot.frame, sensor, place_m};
    lookahead_.push_back(recent);
    Count(recent, lookahead_begin_s_, 1.0);
    seen.spot.Add(place_m, lookahead_begin_s_);
  }
}

void LiveClutter::Count(const Recent& plot, double time_s, double count) {
  Sensor& sensor = SensorAt(plot.sensor);
  for (FadingGrid* grid : {&sensor.wide, &sensor.middle, &sensor.narrow}) {
    grid->Add(plot.position_m, time_s, count);
  }
}

void LiveClutter::Discount() {
  if (std::isfinite(fade_s_)) discount_s_ += kDiscountWindows * fade_s_;
}

void LiveClutter::AddFrame(std::uint32_t sensor, double time_s) {
  time_s += discount_s_;
  Sensor& seen = SensorAt(sensor);
  seen.recent_s.push_back(time_s);
  seen.recent_frames =
      seen.recent_frames * std::exp(-std::max(0.0, time_s - seen.recent_time_s) / kRecentS) + 1.0;
  seen.recent_time_s = std::max(seen.recent_time_s, time_s);
}

// Counts plots older than the exclusion as clutter, and removes warm-up plots that come within it.
void LiveClutter::Settle(double time_s) {
  const double until_s = time_s - exclusion_s_;
  const double from_s = time_s + exclusion_s_;
  for (; !lookahead_.empty() && lookahead_.front().time_s <= from_s; lookahead_.pop_front()) {
    Count(lookahead_.front(), lookahead_begin_s_, -1.0);
  }
  for (; !recent_.empty() && recent_.front().time_s < until_s; recent_.pop_front()) {
    Count(recent_.front(), recent_.front().time_s, 1.0);
  }
  for (Sensor& sensor : sensors_) {
    while (!sensor.lookahead_s.empty() && sensor.lookahead_s.front() <= from_s)
      sensor.lookahead_s.pop_front();
    for (; !sensor.recent_s.empty() && sensor.recent_s.front() < until_s;
         sensor.recent_s.pop_front()) {
      const double at_s = sensor.recent_s.front();
      sensor.frames = sensor.frames * std::exp((sensor.time_s - at_s) / fade_s_) + 1.0;
      sensor.time_s = at_s;
    }
  }
}

void LiveClutter::Judge(const Support& support, double time_s, std::vector<LivePlot>* plots) {
  time_s += discount_s_;
  Settle(time_s);
  for (LivePlot& seen : *plots) {
    Plot& plot = seen.plot;
    const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
    static_grid_.Add(place_m, time_s);
    surroundings_.Add(place_m, time_s);
    const double here = static_grid_.CountAt(place_m, time_s);
    const double chance = surroundings_.CountAt(place_m, time_s) * static_grid_.VolumeM3(place_m) /
                          surroundings_.VolumeM3(place_m);
    const bool is_static = here >= kMinStaticCount && here > chance + 3.0 * std::sqrt(chance);
    if (is_static) static_plots_.push_back({time_s, plot.ray_m});
    Sensor& sensor = SensorAt(plot.sensor);
    sensor.recent_plots.Add(place_m, time_s);
    // An object that is hit only occasionally is a twig or a wire.
    const bool is_persistent =
        sensor.recent_plots.CountAt(place_m, time_s) >= kPersistentShare * sensor.recent_frames;
    // Fog may hide the support.
    plot.is_floating = is_static && is_persistent && !is_blinded_ && support.IsFloating(place_m);
  }
  while (!static_plots_.empty() && static_plots_.front().time_s < time_s - kSimultaneousS) {
    static_plots_.pop_front();
  }
  for (LivePlot& seen : *plots) {
    Plot& plot = seen.plot;
    if (plot.is_floating) plot.is_floating = !HasNeighbours(plot, support.config(), time_s);
  }
  for (LivePlot& seen : *plots) {
    Plot& plot = seen.plot;
    const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
    Sensor& sensor = SensorAt(plot.sensor);
    const double frames =
        std::max(1.0, sensor.frames + static_cast<double>(sensor.lookahead_s.size()));
    double rate = 1e-6;
    for (const FadingGrid* grid : {&sensor.wide, &sensor.middle, &sensor.narrow}) {
      const double exposure = frames * grid->VolumeM3(place_m);
      rate = ClutterRate(grid->CountAt(place_m, time_s), exposure, rate);
    }
    plot.log_clutter = std::log(rate);
    seen.log_surrounding_clutter = plot.log_clutter;
    const bool is_lookahead = time_s <= lookahead_end_s_;
    const double others = sensor.spot.CountAt(place_m, time_s) - (is_lookahead ? 1.0 : 0.0);
    if (!is_lookahead) sensor.spot.Add(place_m, time_s);
    if (!plot.is_floating) {
      const double spot_rate =
          others / std::max(frames, sensor.lookahead_frames) / PlotVolumeM3(plot);
      plot.log_clutter = std::log(std::max({rate, spot_rate, plot.place_rate}));
    }
    recent_.push_back({time_s, plot.frame, plot.sensor, place_m});
  }
}

// True if a floating plot has more simultaneous static neighbours than chance explains: they
// probably share a support.
bool LiveClutter::HasNeighbours(const Plot& plot, const SupportConfig& support, double time_s) {
  const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
  const double reach_m = SupportReachM(plot.ray_m.norm(), support);
  double self = 0.0;
  double num_neighbours = 0.0;
  double num_outer = 0.0;
  for (const StaticPlot& other : static_plots_) {
    const double distance_m = (plot.ray_m - other.position_m).norm();
    if (distance_m >= kOuterReachFactor * reach_m) continue;
    (distance_m <= kObjectRadiusM ? self
     : distance_m < reach_m       ? num_neighbours
                                  : num_outer) += 1.0;
  }
  floating_.Add(place_m, time_s);
  self_.Add(place_m, time_s, self);
  neighbours_.Add(place_m, time_s, num_neighbours);
  outer_.Add(place_m, time_s, num_outer);
  // Each neighbour was counted once for each of the plot's own detections near in time.
  const double times = self_.CountAt(place_m, time_s) / floating_.CountAt(place_m, time_s);
  const double chance = outer_.CountAt(place_m, time_s) / times /
                        (kOuterReachFactor * kOuterReachFactor * kOuterReachFactor - 1.0);
  return neighbours_.CountAt(place_m, time_s) / times > chance + 2.0 * std::sqrt(chance);
}

void LiveClutter::RemoveFromClutter(const Plot& plot) {
  const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
  for (auto at = recent_.begin(); at != recent_.end(); ++at) {
    if (at->frame != plot.frame || at->position_m != place_m) continue;
    sensors_[at->sensor].spot.Add(place_m, at->time_s, -1.0);
    recent_.Erase(at);
    return;
  }
}

void LiveClutter::Sweep(double time_s) {
  time_s += discount_s_;
  for (Sensor& sensor : sensors_) {
    for (FadingGrid* grid :
         {&sensor.wide, &sensor.middle, &sensor.narrow, &sensor.spot, &sensor.recent_plots}) {
      grid->Sweep(time_s);
    }
  }
  for (FadingGrid* grid :
       {&static_grid_, &surroundings_, &floating_, &self_, &neighbours_, &outer_}) {
    grid->Sweep(time_s);
  }
}

}  // namespace unlidar
