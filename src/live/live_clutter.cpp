#include "live/live_clutter.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "scene/plots.hpp"

namespace unlidar {
namespace {

constexpr std::uint32_t kRecentBins = 6;
constexpr double kPersistentShare = 0.2;  // of the recent frames of its sensor with a plot there
constexpr BinRange kAllBins{0, std::numeric_limits<std::uint32_t>::max()};

BinRange Recent(std::uint32_t bin) { return {bin + 1 - std::min(bin + 1, kRecentBins), bin + 1}; }

}  // namespace

LiveClutter::LiveClutter(const RobustConfig& config, double window_s)
    : place_(config.background.place),
      window_bins_(window_s / kBinS),
      num_levels_(config.Uses(Rule::kLocalClutter) ? ClutterMap::kNumLevels : 1),
      static_places_(config.background.place) {}

LiveClutter::Sensor& LiveClutter::SensorAt(std::uint32_t sensor) {
  while (sensors_.size() <= sensor) sensors_.push_back({RangeGrid(place_)});
  return sensors_[sensor];
}

std::uint32_t LiveClutter::CountFrames(const Sensor& sensor, BinRange bins) {
  std::uint32_t count = 0;
  for (const FrameCount& at : sensor.frames) {
    if (bins.first <= at.bin && at.bin < bins.last) count += at.count;
  }
  return count;
}

void LiveClutter::AddFrame(std::uint32_t sensor, std::uint32_t bin,
                           const std::vector<LivePlot>& plots) {
  Sensor& own = SensorAt(sensor);
  if (own.frames.empty() || own.frames.back().bin != bin) own.frames.push_back({bin, 0});
  ++own.frames.back().count;
  for (const LivePlot& seen : plots) {
    clutter_.Add(sensor, seen.plot.PlaceM().cast<float>(), bin);
    if (seen.plot.IsFromTravel()) along_.Add(sensor, seen.plot.carrier_ray_m, bin);
  }
}

void LiveClutter::AddLookahead(std::uint32_t sensor, std::uint32_t bin,
                               const std::vector<LivePlot>& plots) {
  AddFrame(sensor, bin, plots);
  ++lookahead_frames_;
}

void LiveClutter::Judge(const Support& support, std::uint32_t sensor, std::uint32_t bin,
                        std::vector<LivePlot>* plots) {
  const bool was_added = lookahead_frames_ > 0;
  if (was_added) --lookahead_frames_;
  const std::uint32_t recent_frames =
      CountFrames(SensorAt(sensor), Recent(bin)) + (was_added ? 0U : 1U);
  MarkFloating(support, bin, recent_frames, plots);
  const Sensor& own = SensorAt(sensor);
  const std::uint32_t all_frames = CountFrames(own, kAllBins);
  const std::uint32_t frames = all_frames - CountFrames(own, ClutterMap::Excluded(bin));
  for (LivePlot& seen : *plots) {
    Plot& plot = seen.plot;
    const Eigen::Vector3f place_m = plot.PlaceM().cast<float>();
    const auto levels =
        clutter_.LevelsAt(sensor, place_m, clutter_.ExcludedAt(sensor, place_m, bin));
    double rate = RateAtOtherTimes(levels, frames, 0, num_levels_);
    if (plot.IsFromTravel()) {
      const Eigen::Vector3f& ray_m = plot.carrier_ray_m;
      const auto along = along_.LevelsAt(sensor, ray_m, along_.ExcludedAt(sensor, ray_m, bin));
      rate = std::max(rate, RateAtOtherTimes(along, frames, 0, ClutterMap::kNumAlongLevels));
    }
    seen.log_surrounding_clutter = plot.log_clutter = std::log(rate);
    if (plot.is_floating) continue;
    // method.md (3) and (4): a plot of a dwell is predicted by those before it.
    const double others = clutter_.AllAtSpot(sensor, place_m) - (was_added ? 1.0 : 0.0);
    const double spot_rate = others / std::max(all_frames, 1U) / PlotVolumeM3(plot);
    plot.log_clutter = std::log(std::max({rate, spot_rate, plot.place_rate}));
  }
  if (!was_added) AddFrame(sensor, bin, *plots);
}

// `recent_frames`: number of frames of the sensor in the recent bins.
void LiveClutter::MarkFloating(const Support& support, std::uint32_t bin,
                               std::uint32_t recent_frames, std::vector<LivePlot>* plots) {
  for (LivePlot& seen : *plots) {
    Plot& plot = seen.plot;
    const Eigen::Vector3f place_m = plot.PlaceM().cast<float>();
    Sensor& sensor = SensorAt(plot.sensor);
    static_places_.Add(place_m, bin);
    sensor.places.Add(place_m, bin);
    const bool is_static = static_places_.IsStatic(place_m);
    if (is_static) static_plots_.push_back({plot.frame_time_ns, plot.PlaceM()});
    // An object that is hit only occasionally is a twig or a wire.
    const bool is_persistent =
        sensor.places.Count(place_m, Recent(bin)) >= kPersistentShare * recent_frames;
    // Fog may hide the support.
    plot.is_floating = is_static && is_persistent && !is_blinded_ && support.IsFloating(place_m);
  }
  if (plots->empty()) return;
  // Twice as long before: later plots are not known yet.
  const TimeNs oldest_ns = plots->front().plot.frame_time_ns - 2 * NeighbourTest::kSameTimeNs;
  while (!static_plots_.empty() && static_plots_.front().time_ns < oldest_ns) {
    static_plots_.pop_front();
  }
  for (LivePlot& seen : *plots) {
    Plot& plot = seen.plot;
    if (!plot.is_floating) continue;
    const double reach_m = SupportReachM(plot.ray_m.norm(), support.config());
    Neighbours neighbours;
    for (const StaticPlot& other : static_plots_) {
      neighbours.Add((plot.PlaceM() - other.position_m).norm(), reach_m);
    }
    const Eigen::Vector3f place_m = plot.PlaceM().cast<float>();
    neighbour_test_.Add(place_m, bin, neighbours);
    plot.is_floating = !neighbour_test_.HasNeighbours(place_m);
  }
}

void LiveClutter::RemoveFromClutter(const LivePlot& seen) {
  if (seen.bin < forgotten_bins_) return;
  const Plot& plot = seen.plot;
  clutter_.Add(plot.sensor, plot.PlaceM().cast<float>(), seen.bin, -1);
  if (plot.IsFromTravel()) along_.Add(plot.sensor, plot.carrier_ray_m, seen.bin, -1);
}

void LiveClutter::Restart(std::uint32_t bin) {
  if (std::isfinite(window_bins_)) Forget(bin);
}

void LiveClutter::Sweep(std::uint32_t newest_bin) {
  if (newest_bin > window_bins_) Forget(newest_bin - static_cast<std::uint32_t>(window_bins_));
}

void LiveClutter::Forget(std::uint32_t before_bin) {
  forgotten_bins_ = before_bin;
  clutter_.Forget(before_bin);
  along_.Forget(before_bin);
  static_places_.Forget(before_bin);
  neighbour_test_.Forget(before_bin);
  for (Sensor& sensor : sensors_) {
    sensor.places.Forget(before_bin);
    while (!sensor.frames.empty() && sensor.frames.front().bin < before_bin) {
      sensor.frames.pop_front();
    }
  }
}

}  // namespace unlidar
