#include "scene/clutter.hpp"

#include <cmath>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

// The widest neighbourhood reaches across a scene. Where nothing is known the rate is that of an
// empty sky.
constexpr RangeRadius kWide{4.0, 0.35};
constexpr RangeRadius kMiddle{4.0, 0.12};
constexpr double kEmptySkyRate = 1e-6;
// Prior share of plots that recur at their spots, with the weight of one plot.
constexpr double kPriorRecurrenceShare = 0.5;

// Among strays many plots of a bin share a voxel.
RangeGrid CachedGrid(const RangeRadius& radius) {
  return RangeGrid(radius, RangeGrid::CountCache::kPerVoxel);
}

// Returns the clutter intensity (plots per m^3 and frame) at a place, method.md (2), given the
// plots of other times around it and the number of frames that could have shown them. Each level is
// the prior of the next, so that an empty neighbourhood takes the rate of its surroundings, and a
// level is weighted by its exposure. `num_excluded`: of the plots in every level. `num_levels`: of
// the widest.
double RateAtOtherTimes(const ClutterMap::Levels& levels, double num_frames,
                        std::uint32_t num_excluded, std::size_t num_levels) {
  double rate = kEmptySkyRate;
  for (std::size_t k = 0; k < num_levels; ++k) {
    const ClutterMap::Level& level = levels[k];
    rate = ClutterRate(level.count - std::min(level.count, num_excluded),
                       num_frames * level.volume_m3, rate);
  }
  return rate;
}

Eigen::Vector3f PlaceM(const Plot& plot) { return plot.PlaceM().cast<float>(); }

// Clutter of a recording, with hindsight.
class ClutterEstimate {
 public:
  ClutterEstimate(const std::vector<StationModel>& station_models, const RobustConfig& config,
                  const std::vector<char>& assigned, const std::vector<Plot>& plots)
      : assigned_(assigned), plots_(plots), model_(config), recurrent_(station_models.size()) {
    for (std::uint32_t sensor = 0; sensor < station_models.size(); ++sensor) {
      const TimeBins& bins = *station_models[sensor].bins;
      for (std::uint32_t bin = 0; bin < bins.num_bins(); ++bin) {
        model_.AddFrames(sensor, bin, bins.NumFrames(sensor, {bin, bin + 1}));
      }
    }
    for (const Plot& plot : plots) {
      bins_.push_back(station_models[plot.sensor].bins->BinOf(plot.time_ns));
    }
    same_time_.resize(plots.size());
    at_other_times_.resize(plots.size());
    recurrent_excluded_.resize(plots.size());
    Walk(
        [&](std::size_t i) {
          if (assigned_[i] == 0) model_.Add(plots_[i], bins_[i]);
        },
        [&](std::size_t i) { same_time_[i] = model_.SameTimeOf(plots_[i], bins_[i]); });
    for (std::size_t i = 0; i < plots.size(); ++i) {
      at_other_times_[i] = model_.NumAtSpot(plots[i]) - same_time_[i].at_spot;
    }
    Walk(
        [&](std::size_t i) {
          if (assigned_[i] != 0 || at_other_times_[i] == 0) return;
          recurrent_[plots_[i].sensor].Add(PlaceM(plots_[i]), bins_[i]);
        },
        [&](std::size_t i) {
          if (!MayBeOneDwell(i)) return;
          recurrent_excluded_[i] =
              recurrent_[plots_[i].sensor].ExcludedAt(PlaceM(plots_[i]), bins_[i]);
        });
  }

  // Returns the log of the clutter intensity of plot `i`.
  double LogClutter(std::size_t i) const {
    const Plot& plot = plots_[i];
    // Plots at the spot of a floating plot are not clutter, whatever their time.
    const double rate = model_.SurroundingRate(plot, bins_[i], same_time_[i],
                                               plot.is_floating ? at_other_times_[i] : 0);
    if (plot.is_floating) return std::log(rate);
    // The place of an assigned plot may have been revisited by its own target.
    const double min_rate = std::max(rate, assigned_[i] ? 0.0 : plot.place_rate);
    const ClutterModel::SpotRate spot_rate = model_.SpotRateOf(plot);
    const auto log_rate = [&](std::uint32_t others) {
      return std::log(std::max(min_rate, spot_rate.Given(others)));
    };
    const std::uint32_t num_in_dwell = NumInDwell(i);
    if (!MayBeOneDwell(i)) return log_rate(at_other_times_[i] + num_in_dwell - 1);
    // method.md (4): all of them may be one dwell of a target. By the chain rule the k-th plot is
    // then predicted only by the k - 1 before it, and each gets an equal share of the logarithm.
    double sum = 0.0;
    for (std::uint32_t k = 0; k < num_in_dwell; ++k) sum += log_rate(k);
    const double share = RecurrenceShare(i);
    return share * log_rate(num_in_dwell - 1) + (1.0 - share) * sum / num_in_dwell;
  }

 private:
  // Calls `add` for each plot by rising bin, and `count` as soon as the bins excluded for a plot
  // are complete: a map finds its latest bins first.
  template <class Add, class CountAt>
  void Walk(const Add& add, const CountAt& count) const {
    std::vector<std::uint32_t> by_bin = NumbersBelow(plots_.size());
    std::stable_sort(by_bin.begin(), by_bin.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return bins_[a] < bins_[b]; });
    auto next = by_bin.begin();
    for (const std::uint32_t i : by_bin) {
      const std::uint32_t end = ClutterMap::Excluded(bins_[i]).last;
      for (; next != by_bin.end() && bins_[*next] < end; ++next) add(*next);
      count(i);
    }
  }

  // Number of plots of the spot that may be of one dwell, including this one.
  std::uint32_t NumInDwell(std::size_t i) const {
    return same_time_[i].at_spot + (assigned_[i] ? 1U : 0U);
  }

  // True if two or more plots at a spot may all be of one dwell.
  bool MayBeOneDwell(std::size_t i) const { return at_other_times_[i] == 0 && NumInDwell(i) >= 2; }

  // Returns the share of the plots around a plot that recur at their spots, as twigs do.
  double RecurrenceShare(std::size_t i) const {
    const Plot& plot = plots_[i];
    const auto all = model_.LevelsAt(plot, same_time_[i]);
    const auto again = recurrent_[plot.sensor].LevelsAt(PlaceM(plot), recurrent_excluded_[i]);
    double share = kPriorRecurrenceShare;
    for (std::size_t k = 0; k < model_.num_levels(); ++k) {
      share = (again[k].count + share) / (all[k].count + 1.0);
    }
    return share;
  }

  const std::vector<char>& assigned_;
  const std::vector<Plot>& plots_;
  ClutterModel model_;
  std::vector<ClutterMap> recurrent_;                        // (sensors) plots that recur
  std::vector<std::uint32_t> bins_;                          // (plots)
  std::vector<ClutterModel::SameTime> same_time_;            // (plots)
  std::vector<std::uint32_t> at_other_times_;                // (plots) at the spots of plots
  std::vector<ClutterMap::LevelCounts> recurrent_excluded_;  // (plots that may be of one dwell)
};

}  // namespace

ClutterMap::ClutterMap()
    : levels_{CachedGrid(kWide), CachedGrid(kMiddle), CachedGrid(kClutterNarrow)} {}

void ClutterMap::Add(const Eigen::Vector3f& place_m, std::uint32_t bin, std::int32_t count) {
  for (RangeGrid& level : levels_) level.Add(place_m, bin, count);
}

ClutterMap::LevelCounts ClutterMap::ExcludedAt(const Eigen::Vector3f& place_m,
                                               std::uint32_t bin) const {
  LevelCounts counts;
  for (std::size_t k = 0; k < kNumLevels; ++k) {
    counts[k] = levels_[k].Count(place_m, Excluded(bin));
  }
  return counts;
}

ClutterMap::Levels ClutterMap::LevelsAt(const Eigen::Vector3f& place_m,
                                        const LevelCounts& excluded) const {
  Levels levels;
  for (std::size_t k = 0; k < kNumLevels; ++k) {
    levels[k] = {levels_[k].Count(place_m) - excluded[k], levels_[k].VolumeM3(place_m)};
  }
  return levels;
}

void ClutterMap::Forget(std::uint32_t before_bin) {
  for (RangeGrid& level : levels_) level.Forget(before_bin);
}

ClutterModel::ClutterModel(const RobustConfig& config)
    : num_levels_(config.Uses(Rule::kLocalClutter) ? ClutterMap::kNumLevels : 1),
      knows_squalls_(config.Uses(Rule::kSurge)) {}

void ClutterModel::AddFrames(std::uint32_t sensor, std::uint32_t bin, std::uint32_t count) {
  if (sensors_.size() <= sensor) sensors_.resize(sensor + 1);
  sensors_[sensor].num_frames += count;
  Queue<FrameCount>& by_bin = sensors_[sensor].by_bin;
  const auto at = FirstFrom(by_bin, &FrameCount::bin, bin);
  if (at != by_bin.end() && at->bin == bin) {
    at->num_frames += count;
  } else {
    by_bin.Insert(at, {bin, count, 0});
  }
}

ClutterModel::FrameCount ClutterModel::CountIn(std::uint32_t sensor, BinRange bins) const {
  const Queue<FrameCount>& by_bin = sensors_[sensor].by_bin;
  FrameCount sum;
  auto at = FirstFrom(by_bin, &FrameCount::bin, bins.first);
  for (; at != by_bin.end() && at->bin < bins.last; ++at) {
    sum.num_frames += at->num_frames;
    sum.num_plots += at->num_plots;
  }
  return sum;
}

void ClutterModel::Add(const Plot& plot, std::uint32_t bin, std::int32_t count) {
  Sensor& sensor = sensors_[plot.sensor];
  sensor.around.Add(PlaceM(plot), bin, count);
  sensor.spots.Add(PlaceM(plot), bin, count);
  if (plot.IsFromTravel()) sensor.along.Add(plot.carrier_ray_m, bin, count);
  const auto at = FirstFrom(sensor.by_bin, &FrameCount::bin, bin);
  if (at == sensor.by_bin.end() || at->bin != bin) return;
  at->num_plots += static_cast<std::uint32_t>(count);
  sensor.num_plots += static_cast<std::uint32_t>(count);
}

bool ClutterModel::IsSquall(std::uint32_t sensor, std::uint32_t bin) const {
  if (!knows_squalls_) return false;
  const FrameCount present = CountIn(sensor, {bin, bin + 1});
  const FrameCount excluded = CountIn(sensor, ClutterMap::Excluded(bin));
  const Sensor& its = sensors_[sensor];
  const std::uint32_t num_other_frames = its.num_frames - excluded.num_frames;
  if (num_other_frames == 0 || present.num_frames == 0) return false;
  const double usual = static_cast<double>(its.num_plots - excluded.num_plots) / num_other_frames;
  return static_cast<double>(present.num_plots) / present.num_frames > usual + kSwarmPlots;
}

double ClutterModel::PresentRate(const Plot& plot, std::uint32_t bin) const {
  const BinRange present{bin, bin + 1};
  const ClutterMap::Level about = sensors_[plot.sensor].around.WidestAt(PlaceM(plot), present);
  const double num_others =
      static_cast<double>(about.count) / NumFrames(plot.sensor, present) - 1.0;
  return std::max(0.0, num_others) / about.volume_m3;
}

void ClutterModel::Forget(std::uint32_t before_bin) {
  for (std::uint32_t sensor = 0; sensor < sensors_.size(); ++sensor) Forget(sensor, before_bin);
}

void ClutterModel::Forget(std::uint32_t sensor, std::uint32_t before_bin) {
  Sensor& its = sensors_[sensor];
  its.first_bin = std::max(its.first_bin, before_bin);
  its.around.Forget(before_bin);
  its.along.Forget(before_bin);
  its.spots.Forget(before_bin);
  while (!its.by_bin.empty() && its.by_bin.front().bin < before_bin) {
    its.num_frames -= its.by_bin.front().num_frames;
    its.num_plots -= its.by_bin.front().num_plots;
    its.by_bin.pop_front();
  }
}

ClutterModel::SameTime ClutterModel::SameTimeOf(const Plot& plot, std::uint32_t bin) const {
  const Sensor& sensor = sensors_[plot.sensor];
  SameTime same_time;
  same_time.around = sensor.around.ExcludedAt(PlaceM(plot), bin);
  same_time.at_spot = sensor.spots.Count(PlaceM(plot), ClutterMap::Excluded(bin));
  if (plot.IsFromTravel()) same_time.along = sensor.along.ExcludedAt(plot.carrier_ray_m, bin);
  return same_time;
}

double ClutterModel::SurroundingRate(const Plot& plot, std::uint32_t bin, const SameTime& same_time,
                                     std::uint32_t num_excluded) const {
  const Sensor& sensor = sensors_[plot.sensor];
  const double num_frames = sensor.num_frames - NumFrames(plot.sensor, ClutterMap::Excluded(bin));
  const double rate =
      RateAtOtherTimes(LevelsAt(plot, same_time), num_frames, num_excluded, num_levels_);
  if (!plot.IsFromTravel()) return rate;
  const auto along = sensor.along.LevelsAt(plot.carrier_ray_m, same_time.along);
  return std::max(rate, RateAtOtherTimes(along, num_frames, 0, ClutterMap::kNumAlongLevels));
}

std::uint32_t ClutterModel::NumAtSpot(const Plot& plot) const {
  return sensors_[plot.sensor].spots.Count(PlaceM(plot));
}

ClutterModel::SpotRate ClutterModel::SpotRateOf(const Plot& plot) const {
  const Sensor& sensor = sensors_[plot.sensor];
  const double num_frames = std::max(sensor.num_frames, 1U);
  SpotRate rate;
  rate.per_plot = 1.0 / num_frames / PlotVolumeM3(plot);
  if (plot.stray_group_rate > 0.0F) {
    rate.num_strays = plot.stray_group_rate * num_frames * sensor.spots.VolumeM3(PlaceM(plot));
  }
  return rate;
}

ClutterMap::Levels ClutterModel::LevelsAt(const Plot& plot, const SameTime& same_time) const {
  return sensors_[plot.sensor].around.LevelsAt(PlaceM(plot), same_time.around);
}

ClutterModel::Intensity ClutterModel::IntensityOf(const Plot& plot, std::uint32_t bin,
                                                  bool is_squall) const {
  const double rate = SurroundingRate(plot, bin, SameTimeOf(plot, bin), 0);
  if (plot.is_floating) return {std::log(rate), std::log(rate)};
  const double spot_rate = SpotRateOf(plot).Given(NumAtSpot(plot) - 1.0);
  const double surrounding_rate = is_squall ? std::max(rate, PresentRate(plot, bin)) : rate;
  return {std::log(surrounding_rate),
          std::log(std::max({surrounding_rate, spot_rate, plot.place_rate}))};
}

double PlotVolumeM3(const Plot& plot) {
  return std::pow(2.0 * M_PI * std::exp(1.0) * plot.variance_m2, 1.5);
}

void EstimateClutter(const std::vector<StationModel>& station_models, const RobustConfig& config,
                     const std::vector<char>& assigned, std::vector<Plot>* plots) {
  const ClutterEstimate estimate(station_models, config, assigned, *plots);
  for (std::size_t i = 0; i < plots->size(); ++i) (*plots)[i].log_clutter = estimate.LogClutter(i);
}

}  // namespace unlidar
