#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/plots.hpp"

namespace unlidar {
namespace {

// Prior share of plots that recur at their spots, with the weight of one plot.
constexpr double kPriorRecurrenceShare = 0.5;

class ClutterEstimate {
 public:
  ClutterEstimate(const std::vector<StationModel>& station_models, const RobustConfig& config,
                  const std::vector<char>& assigned, const std::vector<Plot>& plots)
      : station_models_(station_models), assigned_(assigned), plots_(plots) {
    for (const Plot& plot : plots) bins_.push_back(BackgroundOf(plot).BinOf(plot.time_ns));
    const std::vector<RangeGrid> spots = GridsOf(kSpotRadius, [](std::size_t) { return true; });
    for (std::size_t i = 0; i < plots.size(); ++i) spots_.push_back(CountsAt(spots, i));
    SetRates(config.Uses(Rule::kLocalClutter)
                 ? std::vector<RangeRadius>{kClutterWide, kClutterMiddle, kClutterNarrow}
                 : std::vector<RangeRadius>{kClutterWide});
  }

  // Returns the log of the clutter intensity of plot `i`, per m^3 and frame of its sensor.
  double LogClutter(std::size_t i) const {
    const Plot& plot = plots_[i];
    if (plot.is_floating) return std::log(rates_[i]);
    // The place of an assigned plot may have been revisited by its own target.
    const double min_rate = std::max(rates_[i], assigned_[i] ? 0.0 : plot.place_rate);
    // method.md (3): a static object that is seldom hit would yield the plots of its spot at their
    // observed rate, the plot under test left out.
    const double plot_rate = 1.0 / NumFrames(plot) / PlotVolumeM3(plot);
    const auto log_rate = [&](std::uint32_t others) {
      return std::log(std::max(min_rate, others * plot_rate));
    };
    const std::uint32_t num_in_dwell = NumInDwell(i);
    if (!MayBeSingleDwell(i)) return log_rate(spots_[i].at_other_times + num_in_dwell - 1);
    // method.md (4): all of them may be one dwell of a target. By the chain rule the k-th plot is
    // then predicted only by the k - 1 before it, and each gets an equal share of the logarithm.
    double sum = 0.0;
    for (std::uint32_t k = 0; k < num_in_dwell; ++k) sum += log_rate(k);
    return recurrence_shares_[i] * log_rate(num_in_dwell - 1) +
           (1.0 - recurrence_shares_[i]) * sum / num_in_dwell;
  }

 private:
  // Plots in a neighbourhood: those that may be of the same dwell, and those of other times.
  struct Counts {
    std::uint32_t near = 0;
    std::uint32_t at_other_times = 0;
  };

  // Plots of the spot that may be of one dwell, including plot `i`.
  std::uint32_t NumInDwell(std::size_t i) const {
    return spots_[i].near + (assigned_[i] ? 1U : 0U);
  }

  // True if these are all plots of the spot, and more than one.
  bool MayBeSingleDwell(std::size_t i) const {
    return spots_[i].at_other_times == 0 && NumInDwell(i) > 1;
  }

  const Background& BackgroundOf(const Plot& plot) const {
    return *station_models_[plot.sensor].background;
  }

  std::uint32_t NumFrames(const Plot& plot) const {
    return BackgroundOf(plot).NumFrames(plot.sensor, {0, BackgroundOf(plot).num_bins()});
  }

  BinRange Near(std::size_t i) const {
    return BackgroundOf(plots_[i]).BinsAround(bins_[i],
                                              static_cast<std::uint32_t>(kClutterExclusionBins));
  }

  // Returns grids (sensors) of the unassigned plots for which `counts` is true.
  template <class Selection>
  std::vector<RangeGrid> GridsOf(const RangeRadius& radius, const Selection& counts) const {
    std::vector<RangeGrid> grids(station_models_.size(), RangeGrid(radius));
    for (std::size_t i = 0; i < plots_.size(); ++i) {
      if (assigned_[i] != 0 || !counts(i)) continue;
      grids[plots_[i].sensor].Add(plots_[i].ray_m.cast<float>(), bins_[i]);
    }
    return grids;
  }

  Counts CountsAt(const std::vector<RangeGrid>& grids, std::size_t i) const {
    const RangeGrid& grid = grids[plots_[i].sensor];
    const Eigen::Vector3f place_m = plots_[i].ray_m.cast<float>();
    const std::uint32_t near = grid.Count(place_m, Near(i));
    return {near, grid.Count(place_m) - near};
  }

  // Sets the rate of plots around each plot at other times, method.md (2), and, where LogClutter()
  // needs it, the share of them that recur at their spots, as twigs do. From wide to narrow: each
  // level is the prior of the next, so that an empty neighbourhood takes the rate of its
  // surroundings, and a level is weighted by its exposure.
  void SetRates(const std::vector<RangeRadius>& neighbourhoods) {
    rates_.assign(plots_.size(), 1e-6);
    recurrence_shares_.assign(plots_.size(), kPriorRecurrenceShare);
    for (const RangeRadius& radius : neighbourhoods) {
      const std::vector<RangeGrid> all = GridsOf(radius, [](std::size_t) { return true; });
      const std::vector<RangeGrid> again =
          GridsOf(radius, [&](std::size_t i) { return spots_[i].at_other_times > 0; });
      for (std::size_t i = 0; i < plots_.size(); ++i) {
        const Plot& plot = plots_[i];
        std::uint32_t count = CountsAt(all, i).at_other_times;
        // Plots at the spot of a floating plot are not clutter, whatever their time.
        if (plot.is_floating) count -= std::min(count, spots_[i].at_other_times);
        const std::uint32_t frames =
            NumFrames(plot) - BackgroundOf(plot).NumFrames(plot.sensor, Near(i));
        const double exposure = frames * all[plot.sensor].VolumeM3(plot.ray_m.cast<float>());
        rates_[i] = ClutterRate(count, exposure, rates_[i]);
        if (!MayBeSingleDwell(i)) continue;
        recurrence_shares_[i] =
            (CountsAt(again, i).at_other_times + recurrence_shares_[i]) / (count + 1.0);
      }
    }
  }

  const std::vector<StationModel>& station_models_;
  const std::vector<char>& assigned_;
  const std::vector<Plot>& plots_;
  std::vector<std::uint32_t> bins_;  // (plots), like the next three
  std::vector<Counts> spots_;
  std::vector<double> rates_;
  std::vector<double> recurrence_shares_;
};

}  // namespace

double PlotVolumeM3(const Plot& plot) {
  return std::pow(2.0 * M_PI * std::exp(1.0) * plot.variance_m2, 1.5);
}

void SetPlaceRates(const Background& background, std::vector<Plot>* plots) {
  for (Plot& plot : *plots) {
    double sum = 0.0;
    for (const std::uint32_t i : plot.returns) sum += background.PlaceRate(i);
    plot.place_rate = sum / static_cast<double>(plot.returns.size());
  }
}

void EstimateClutter(const std::vector<StationModel>& station_models, const RobustConfig& config,
                     const std::vector<char>& assigned, std::vector<Plot>* plots) {
  const ClutterEstimate estimate(station_models, config, assigned, *plots);
  for (std::size_t i = 0; i < plots->size(); ++i) (*plots)[i].log_clutter = estimate.LogClutter(i);
}

}  // namespace unlidar
