#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
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
    const auto add = [&](std::size_t i, ClutterMap* map) {
      if (assigned[i] == 0) map->Add(plots[i].sensor, plots[i].ray_m.cast<float>(), bins_[i]);
    };
    for (std::size_t i = 0; i < plots.size(); ++i) add(i, &all_);
    for (std::size_t i = 0; i < plots.size(); ++i) {
      spots_.push_back(all_.AtSpot(plots[i].sensor, plots[i].ray_m.cast<float>(), bins_[i]));
      if (spots_[i].at_other_times > 0) add(i, &recurrent_);
    }
  }

  // Returns the log of the clutter intensity of plot `i`, per m^3 and frame of its sensor.
  double LogClutter(std::size_t i) const {
    const Plot& plot = plots_[i];
    const TimeBins& bins = BinsOf(plot);
    const auto levels = all_.LevelsAt(plot.sensor, plot.ray_m.cast<float>(), bins_[i]);
    const std::uint32_t num_frames = bins.NumFrames(plot.sensor, {0, bins.num_bins()});
    const std::uint32_t num_excluded =
        bins.NumFrames(plot.sensor, bins.BinsAround(bins_[i], ClutterMap::kExclusionBins));
    // Plots at the spot of a floating plot are not clutter, whatever their time.
    const double rate =
        RateAtOtherTimes(levels, num_frames - num_excluded,
                         plot.is_floating ? spots_[i].at_other_times : 0, num_levels_);
    if (plot.is_floating) return std::log(rate);
    // The place of an assigned plot may have been revisited by its own target.
    const double min_rate = std::max(rate, assigned_[i] ? 0.0 : plot.place_rate);
    // method.md (3): a static object that is seldom hit would yield the plots of its spot at their
    // observed rate, the plot under test left out.
    const double plot_rate = 1.0 / num_frames / PlotVolumeM3(plot);
    const auto log_rate = [&](std::uint32_t others) {
      return std::log(std::max(min_rate, others * plot_rate));
    };
    // Plots of the spot that may be of one dwell, including this one.
    const std::uint32_t num_in_dwell = spots_[i].near + (assigned_[i] ? 1U : 0U);
    if (spots_[i].at_other_times > 0 || num_in_dwell < 2) {
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
  const TimeBins& BinsOf(const Plot& plot) const { return *station_models_[plot.sensor].bins; }

  // Returns the share of the plots around a plot that recur at their spots, as twigs do.
  double RecurrenceShare(
      std::size_t i, const std::array<ClutterMap::Level, ClutterMap::kNumLevels>& levels) const {
    const auto again =
        recurrent_.LevelsAt(plots_[i].sensor, plots_[i].ray_m.cast<float>(), bins_[i]);
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
  std::vector<std::uint32_t> bins_;  // (plots)
  ClutterMap all_;
  ClutterMap recurrent_;                   // those that recur at their spots
  std::vector<ClutterMap::Counts> spots_;  // (plots)
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
