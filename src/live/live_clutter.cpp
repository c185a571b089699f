#include "live/live_clutter.hpp"

#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

constexpr double kAgedWindows = 3.0;  // leave a twentieth of every count
constexpr double kWider = 3.0;        // the surroundings of a place, times its radius
constexpr double kMinStanding = 3.0;
constexpr double kCompanySlope = 0.01;
constexpr double kFarther = 5.0;    // the surroundings of a floating thing, times its reach
constexpr double kSameTimeS = 0.6;  // before it
constexpr double kLatelyS = 3.0;
constexpr double kSolidShare = 0.2;  // of the frames of its sensor, in which it has a plot

RangeRadius Wider(const RangeRadius& radius) {
  return {kWider * radius.constant_m, kWider * radius.slope};
}

}  // namespace

LiveClutter::LiveClutter(const RobustConfig& config, double fade_s)
    : config_(config.plots),
      exclusion_s_((kClutterExclusionBins + 0.5) * config.background.bin_s),
      fade_s_(fade_s),
      place_(config.background.place),
      standing_(config.background.place, fade_s),
      about_(Wider(config.background.place), fade_s),
      floating_({config.support.body_m, kCompanySlope}, fade_s),
      self_({config.support.body_m, kCompanySlope}, fade_s),
      beside_({config.support.body_m, kCompanySlope}, fade_s),
      farther_({config.support.body_m, kCompanySlope}, fade_s) {}

LiveClutter::Sensor& LiveClutter::SensorAt(std::uint32_t sensor) {
  while (sensors_.size() <= sensor) {
    sensors_.push_back({FadingGrid(kClutterWide, fade_s_),
                        FadingGrid(config_.clutter_middle, fade_s_),
                        FadingGrid(config_.clutter_narrow, fade_s_),
                        FadingGrid(config_.spot, fade_s_), FadingGrid(place_, kLatelyS)});
  }
  return sensors_[sensor];
}

void LiveClutter::Foresee(std::uint32_t sensor, double time_s, const std::vector<SeenPlot>& plots) {
  Sensor& seen = SensorAt(sensor);
  if (foreseen_until_s_ < 0.0) foreseen_from_s_ = time_s;
  foreseen_until_s_ = time_s;
  seen.ahead_s.push_back(time_s);
  seen.frames_foreseen += 1.0;
  for (const SeenPlot& plot : plots) {
    const Eigen::Vector3f place_m = plot.plot.ray_m.cast<float>();
    const Recent recent{time_s, plot.plot.frame, sensor, place_m};
    ahead_.push_back(recent);
    Count(recent, foreseen_from_s_, 1.0);
    seen.spot.Add(place_m, foreseen_from_s_);
  }
}

void LiveClutter::Count(const Recent& plot, double time_s, double count) {
  Sensor& sensor = SensorAt(plot.sensor);
  for (FadingGrid* grid : {&sensor.wide, &sensor.middle, &sensor.narrow}) {
    grid->Add(plot.position_m, time_s, count);
  }
}

void LiveClutter::Age() {
  if (std::isfinite(fade_s_)) aged_s_ += kAgedWindows * fade_s_;
}

void LiveClutter::AddFrame(std::uint32_t sensor, double time_s) {
  time_s += aged_s_;
  Sensor& seen = SensorAt(sensor);
  seen.recent_s.push_back(time_s);
  seen.frames_lately =
      seen.frames_lately * std::exp(-std::max(0.0, time_s - seen.lately_s) / kLatelyS) + 1.0;
  seen.lately_s = std::max(seen.lately_s, time_s);
}

// What is older than the exclusion is clutter from now on, and what was foreseen is none while it
// is as near in time.
void LiveClutter::Settle(double time_s) {
  const double until_s = time_s - exclusion_s_;
  const double from_s = time_s + exclusion_s_;
  for (; !ahead_.empty() && ahead_.front().time_s <= from_s; ahead_.pop_front()) {
    Count(ahead_.front(), foreseen_from_s_, -1.0);
  }
  for (; !recent_.empty() && recent_.front().time_s < until_s; recent_.pop_front()) {
    Count(recent_.front(), recent_.front().time_s, 1.0);
  }
  for (Sensor& sensor : sensors_) {
    while (!sensor.ahead_s.empty() && sensor.ahead_s.front() <= from_s) sensor.ahead_s.pop_front();
    for (; !sensor.recent_s.empty() && sensor.recent_s.front() < until_s;
         sensor.recent_s.pop_front()) {
      const double at_s = sensor.recent_s.front();
      sensor.frames = sensor.frames * std::exp((sensor.time_s - at_s) / fade_s_) + 1.0;
      sensor.time_s = at_s;
    }
  }
}

void LiveClutter::Judge(const Support& support, double time_s, std::vector<SeenPlot>* plots) {
  time_s += aged_s_;
  Settle(time_s);
  for (SeenPlot& seen : *plots) {
    Plot& plot = seen.plot;
    const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
    standing_.Add(place_m, time_s);
    about_.Add(place_m, time_s);
    const double here = standing_.CountAt(place_m, time_s);
    const double chance =
        about_.CountAt(place_m, time_s) * standing_.VolumeM3(place_m) / about_.VolumeM3(place_m);
    const bool is_standing = here >= kMinStanding && here > chance + 3.0 * std::sqrt(chance);
    if (is_standing) standing_plots_.push_back({time_s, plot.ray_m});
    Sensor& sensor = SensorAt(plot.sensor);
    sensor.lately.Add(place_m, time_s);
    // What is hit now and then in one place is a twig or a wire.
    const bool is_solid =
        sensor.lately.CountAt(place_m, time_s) >= kSolidShare * sensor.frames_lately;
    // Fog may hide what holds a thing.
    plot.is_floating = is_standing && is_solid && !is_blinded_ && support.IsFloating(place_m);
  }
  while (!standing_plots_.empty() && standing_plots_.front().time_s < time_s - kSameTimeS) {
    standing_plots_.pop_front();
  }
  for (SeenPlot& seen : *plots) {
    Plot& plot = seen.plot;
    if (plot.is_floating) plot.is_floating = !HasCompany(plot, support.config(), time_s);
  }
  for (SeenPlot& seen : *plots) {
    Plot& plot = seen.plot;
    const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
    Sensor& sensor = SensorAt(plot.sensor);
    const double frames = std::max(1.0, sensor.frames + static_cast<double>(sensor.ahead_s.size()));
    double rate = 1e-6;
    for (const FadingGrid* grid : {&sensor.wide, &sensor.middle, &sensor.narrow}) {
      const double exposure = frames * grid->VolumeM3(place_m);
      rate = ClutterRate(grid->CountAt(place_m, time_s), exposure, rate);
    }
    plot.log_clutter = std::log(rate);
    seen.log_surroundings = plot.log_clutter;
    const bool is_foreseen = time_s <= foreseen_until_s_;
    const double others = sensor.spot.CountAt(place_m, time_s) - (is_foreseen ? 1.0 : 0.0);
    if (!is_foreseen) sensor.spot.Add(place_m, time_s);
    if (!plot.is_floating) {
      const double spot_rate =
          others / std::max(frames, sensor.frames_foreseen) / PlotVolumeM3(plot);
      plot.log_clutter = std::log(std::max({rate, spot_rate, plot.place_rate}));
    }
    recent_.push_back({time_s, plot.frame, plot.sensor, place_m});
  }
}

// Whether more stands beside a floating plot at the same time than by chance: then what holds the
// one up is likely to hold the other.
bool LiveClutter::HasCompany(const Plot& plot, const SupportConfig& support, double time_s) {
  const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
  const double reach_m = support.ReachM(plot.ray_m.norm());
  double self = 0.0;
  double beside = 0.0;
  double farther = 0.0;
  for (const Standing& other : standing_plots_) {
    const double distance_m = (plot.ray_m - other.position_m).norm();
    if (distance_m >= kFarther * reach_m) continue;
    (distance_m <= support.body_m ? self : distance_m < reach_m ? beside : farther) += 1.0;
  }
  floating_.Add(place_m, time_s);
  self_.Add(place_m, time_s, self);
  beside_.Add(place_m, time_s, beside);
  farther_.Add(place_m, time_s, farther);
  // What is beside it was counted once for each of its own plots near in time.
  const double times = self_.CountAt(place_m, time_s) / floating_.CountAt(place_m, time_s);
  const double chance =
      farther_.CountAt(place_m, time_s) / times / (kFarther * kFarther * kFarther - 1.0);
  return beside_.CountAt(place_m, time_s) / times > chance + 2.0 * std::sqrt(chance);
}

void LiveClutter::Explain(const Plot& plot) {
  const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
  for (auto at = recent_.begin(); at != recent_.end(); ++at) {
    if (at->frame != plot.frame || at->position_m != place_m) continue;
    sensors_[at->sensor].spot.Add(place_m, at->time_s, -1.0);
    recent_.Erase(at);
    return;
  }
}

void LiveClutter::Sweep(double time_s) {
  time_s += aged_s_;
  for (Sensor& sensor : sensors_) {
    for (FadingGrid* grid :
         {&sensor.wide, &sensor.middle, &sensor.narrow, &sensor.spot, &sensor.lately}) {
      grid->Sweep(time_s);
    }
  }
  for (FadingGrid* grid : {&standing_, &about_, &floating_, &self_, &beside_, &farther_}) {
    grid->Sweep(time_s);
  }
}

}  // namespace unlidar
