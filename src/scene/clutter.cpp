#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

#include "scene/clutter_map.hpp"
#include "scene/plots.hpp"

namespace unlidar {
namespace {

// Prior share of plots that recur at their spots, with the weight of one plot.
constexpr double kPriorRecurrenceShare = 0.5;

class ClutterEstimate {
 public:
  ClutterEstimate(const std::vector<StationModel>& station_models, const RobustConfig& config,
                  const std::vector<char>& assigned, const std::vector<Plot>& plots)
      : station_models_(station_models),
        assigned_(assigned),
        plots_(plots),
        num_levels_(config.Uses(Rule::kLocalClutter) ? ClutterMap::kNumLevels : 1) {
    for (const Plot& plot : plots) bins_.push_back(BinsOf(plot).BinOf(plot.time_ns));
    by_bin_.resize(plots.size());
    std::iota(by_bin_.begin(), by_bin_.end(), 0U);
    std::stable_sort(by_bin_.begin(), by_bin_.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return bins_[a] < bins_[b]; });
    spots_.resize(plots.size());
    excluded_.resize(plots.size());
    const auto place = [&](std::size_t i) { return PlaceM(i); };
    Fill([&](std::size_t i) { return assigned[i] == 0; }, place,
         [&](std::size_t i) {
           excluded_[i] = all_.ExcludedAt(plots[i].sensor, PlaceM(i), bins_[i]);
           spots_[i].near = all_.ExcludedAtSpot(plots[i].sensor, PlaceM(i), bins_[i]);
         },
         &all_);
    for (std::size_t i = 0; i < plots.size(); ++i) {
      spots_[i].at_other_times = all_.AllAtSpot(plots[i].sensor, PlaceM(i)) - spots_[i].near;
    }
    recurrent_excluded_.resize(plots.size());
    Fill([&](std::size_t i) { return assigned[i] == 0 && spots_[i].at_other_times > 0; }, place,
         [&](std::size_t i) {
           if (!MayBeOneDwell(i)) return;
           recurrent_excluded_[i] = recurrent_.ExcludedAt(plots[i].sensor, PlaceM(i), bins_[i]);
         },
         &recurrent_);
    const auto is_from_travel = [&](std::size_t i) { return plots[i].IsFromTravel(); };
    if (std::none_of(by_bin_.begin(), by_bin_.end(), is_from_travel)) return;
    along_excluded_.resize(plots.size());
    Fill([&](std::size_t i) { return assigned[i] == 0 && is_from_travel(i); },
         [&](std::size_t i) { return plots[i].carrier_ray_m; },
         [&](std::size_t i) {
           if (!is_from_travel(i)) return;
           along_excluded_[i] =
               along_.ExcludedAt(plots[i].sensor, plots[i].carrier_ray_m, bins_[i]);
         },
         &along_);
  }

  // Returns the log of the clutter intensity of plot `i`, per m^3 and frame of its sensor.
  double LogClutter(std::size_t i) const {
    const Plot& plot = plots_[i];
    const TimeBins& bins = BinsOf(plot);
    const auto levels = all_.LevelsAt(plot.sensor, PlaceM(i), excluded_[i]);
    const std::uint32_t num_frames = bins.NumFrames(plot.sensor, {0, bins.num_bins()});
    const std::uint32_t num_excluded =
        bins.NumFrames(plot.sensor, bins.BinsAround(bins_[i], ClutterMap::kExclusionBins));
    // Plots at the spot of a floating plot are not clutter, whatever their time.
    double rate = RateAtOtherTimes(levels, num_frames - num_excluded,
                                   plot.is_floating ? spots_[i].at_other_times : 0, num_levels_);
    if (plot.IsFromTravel()) {
      const auto along = along_.LevelsAt(plot.sensor, plot.carrier_ray_m, along_excluded_[i]);
      rate = std::max(
          rate, RateAtOtherTimes(along, num_frames - num_excluded, 0, ClutterMap::kNumAlongLevels));
    }
    if (plot.is_floating) return std::log(rate);
    // The place of an assigned plot may have been revisited by its own target.
    const double min_rate = std::max(rate, assigned_[i] ? 0.0 : plot.place_rate);
    // method.md (3): a static object that is seldom hit would yield the plots of its spot at their
    // observed rate, the plot under test left out.
    const double plot_rate = 1.0 / num_frames / PlotVolumeM3(plot);
    const auto log_rate = [&](std::uint32_t others) {
      return std::log(std::max(min_rate, others * plot_rate));
    };
    const std::uint32_t num_in_dwell = NumInDwell(i);
    if (!MayBeOneDwell(i)) {
      return log_rate(spots_[i].at_other_times + num_in_dwell - 1);
    }
    // method.md (4): all of them may be one dwell of a target. By the chain rule the k-th plot is
    // then predicted only by the k - 1 before it, and each gets an equal share of the logarithm.
    double sum = 0.0;
    for (std::uint32_t k = 0; k < num_in_dwell; ++k) sum += log_rate(k);
    const double share = RecurrenceShare(i, levels);
    return share * log_rate(num_in_dwell - 1) + (1.0 - share) * sum / num_in_dwell;
  }

 private:
  // Plots at the spot of a plot.
  struct Spot {
    std::uint32_t near = 0;  // in the bins excluded for it
    std::uint32_t at_other_times = 0;
  };

  // Fills a map with the plots that `is_added` selects, at their `place`, and calls `count` for
  // each plot as soon as the bins excluded for it are complete: the map finds its latest bins
  // first.
  template <class IsAdded, class PlaceOf, class CountAt>
  void Fill(const IsAdded& is_added, const PlaceOf& place, const CountAt& count,
            ClutterMap* map) const {
    auto next = by_bin_.begin();
    for (const std::uint32_t i : by_bin_) {
      const std::uint32_t end = ClutterMap::Excluded(bins_[i]).last;
      for (; next != by_bin_.end() && bins_[*next] < end; ++next) {
        if (is_added(*next)) map->Add(plots_[*next].sensor, place(*next), bins_[*next]);
      }
      count(i);
    }
  }

  Eigen::Vector3f PlaceM(std::size_t i) const { return plots_[i].PlaceM().cast<float>(); }

  // Number of plots of the spot that may be of one dwell, including this one.
  std::uint32_t NumInDwell(std::size_t i) const {
    return spots_[i].near + (assigned_[i] ? 1U : 0U);
  }

  // True if two or more plots at a spot may all be of one dwell.
  bool MayBeOneDwell(std::size_t i) const {
    return spots_[i].at_other_times == 0 && NumInDwell(i) >= 2;
  }

  const TimeBins& BinsOf(const Plot& plot) const { return *station_models_[plot.sensor].bins; }

  // Returns the share of the plots around a plot that recur at their spots, as twigs do.
  double RecurrenceShare(
      std::size_t i, const std::array<ClutterMap::Level, ClutterMap::kNumLevels>& levels) const {
    const auto again = recurrent_.LevelsAt(plots_[i].sensor, PlaceM(i), recurrent_excluded_[i]);
    double share = kPriorRecurrenceShare;
    for (std::size_t k = 0; k < num_levels_; ++k) {
      share = (again[k].count + share) / (levels[k].count + 1.0);
    }
    return share;
  }

  const std::vector<StationModel>& station_models_;
  const std::vector<char>& assigned_;
  const std::vector<Plot>& plots_;
  std::size_t num_levels_;
  std::vector<std::uint32_t> bins_;    // (plots)
  std::vector<std::uint32_t> by_bin_;  // plots by rising bin
  ClutterMap all_;
  ClutterMap recurrent_;                                     // those that recur at their spots
  std::vector<ClutterMap::LevelCounts> excluded_;            // (plots) of all_
  std::vector<ClutterMap::LevelCounts> recurrent_excluded_;  // (plots that may be of one dwell)
  std::vector<Spot> spots_;                                  // (plots)
  ClutterMap along_;  // plots of sensors that travel, in the axes of their carriers
  std::vector<ClutterMap::LevelCounts> along_excluded_;  // (plots) empty if none travels
};

}  // namespace

double PlotVolumeM3(const Plot& plot) {
  return std::pow(2.0 * M_PI * std::exp(1.0) * plot.variance_m2, 1.5);
}

void EstimateClutter(const std::vector<StationModel>& station_models, const RobustConfig& config,
                     const std::vector<char>& assigned, std::vector<Plot>* plots) {
  const ClutterEstimate estimate(station_models, config, assigned, *plots);
  for (std::size_t i = 0; i < plots->size(); ++i) (*plots)[i].log_clutter = estimate.LogClutter(i);
}

}  // namespace unlidar
