#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "robust/plots/plots.hpp"

namespace unlidar {
namespace {

// The volume in which the plots of one point-like thing lie: that of a Gaussian of their noise.
double PlotVolumeM3(const Plot& plot) {
  return std::pow(2.0 * M_PI * std::exp(1.0) * plot.variance_m2, 1.5);
}

}  // namespace

void SetPlaceRates(const Background& background, std::vector<Plot>* plots) {
  for (Plot& plot : *plots) {
    double sum = 0.0;
    for (const std::uint32_t i : plot.returns) sum += background.PlaceRate(i);
    plot.place_rate = sum / static_cast<double>(plot.returns.size());
  }
}

void EstimateClutter(const std::vector<SensorView>& views, const PlotConfig& config,
                     const std::vector<char>& explained, std::vector<Plot>* plots) {
  const auto background_of = [&](const Plot& plot) -> const Background& {
    return *views[plot.sensor].background;
  };
  const auto num_frames = [&](const Plot& plot) {
    const Background& background = background_of(plot);
    return background.NumFrames(plot.sensor, {0, background.num_bins()});
  };
  std::vector<std::uint32_t> bins;
  for (const Plot& plot : *plots) bins.push_back(background_of(plot).BinOf(plot.time_ns));

  // From wide to narrow: each level is the prior of the next, so that an empty neighbourhood still
  // has the rate of its surroundings, and a rate is believed only as far as its exposure goes.
  std::vector<double> rate(plots->size(), 1e-6);
  const auto exclusion = static_cast<std::uint32_t>(kClutterExclusionBins);
  for (const RangeRadius& radius : {kClutterWide, config.clutter_middle, config.clutter_narrow}) {
    std::vector<RangeGrid> grids(views.size(), RangeGrid(radius));
    for (std::size_t i = 0; i < plots->size(); ++i) {
      const Plot& plot = (*plots)[i];
      if (!explained[i]) grids[plot.sensor].Add(plot.ray_m.cast<float>(), bins[i]);
    }
    for (std::size_t i = 0; i < plots->size(); ++i) {
      const Plot& plot = (*plots)[i];
      const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
      const RangeGrid& grid = grids[plot.sensor];
      const Background& background = background_of(plot);
      const BinRange near = background.BinsAround(bins[i], exclusion);
      const std::uint32_t count = grid.Count(place_m) - grid.Count(place_m, near);
      const std::uint32_t frames = num_frames(plot) - background.NumFrames(plot.sensor, near);
      const double exposure = frames * grid.VolumeM3(place_m);
      rate[i] = (count + kClutterPriorPlots) / (exposure + kClutterPriorPlots / rate[i]);
    }
  }
  // A static thing that is seldom hit would give the plots of its place at the rate at which they
  // came, the plot itself left out.
  std::vector<RangeGrid> spots(views.size(), RangeGrid(config.spot));
  for (std::size_t i = 0; i < plots->size(); ++i) {
    const Plot& plot = (*plots)[i];
    if (!explained[i]) spots[plot.sensor].Add(plot.ray_m.cast<float>(), bins[i]);
  }
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.log_clutter = std::log(rate[i]);
    if (plot.is_floating) continue;
    // A target that was found may have come back to its own place.
    const double least_rate = std::max(rate[i], explained[i] ? 0.0 : plot.place_rate);
    const RangeGrid& grid = spots[plot.sensor];
    const Eigen::Vector3f place_m = plot.ray_m.cast<float>();
    const BinRange visit = background_of(plot).BinsAround(bins[i], exclusion);
    const std::uint32_t near = grid.Count(place_m, visit) + (explained[i] ? 1U : 0U);
    const std::uint32_t others = grid.Count(place_m) + (explained[i] ? 1U : 0U) - 1U;
    const double plot_rate = 1.0 / num_frames(plot) / PlotVolumeM3(plot);
    const auto log_rate = [&](std::uint32_t num_plots) {
      return std::log(std::max(least_rate, num_plots * plot_rate));
    };
    plot.log_clutter = log_rate(others);
    if (near <= others) continue;  // what comes at other times, too, is static
    // All of them may be one visit of what does not stay. Then the first is not told by the others
    // as these are by it: by the chain rule the k-th has the rate of k - 1, and each gets its share
    // of the logarithm. A static thing's would be as close by chance, the likelier the shorter the
    // recording.
    double sum = 0.0;
    for (std::uint32_t k = 0; k < near; ++k) sum += log_rate(k);
    const double exposure = background_of(plot).NumFrames(plot.sensor, visit);
    const double odds = std::pow(exposure / num_frames(plot), static_cast<double>(others));
    plot.log_clutter = (odds * log_rate(others) + sum / near) / (1.0 + odds);
  }
}

}  // namespace unlidar
