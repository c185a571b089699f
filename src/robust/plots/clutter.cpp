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
    if (!explained[i]) spots[plot.sensor].Add(plot.ray_m.cast<float>(), 0);
  }
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.log_clutter = std::log(rate[i]);
    if (plot.is_floating) continue;
    const double others =
        spots[plot.sensor].Count(plot.ray_m.cast<float>()) - (explained[i] ? 0.0 : 1.0);
    const double spot_rate = others / num_frames(plot) / PlotVolumeM3(plot);
    // A target that was found may have come back to its own place.
    const double place_rate = explained[i] ? 0.0 : plot.place_rate;
    plot.log_clutter = std::log(std::max({rate[i], spot_rate, place_rate}));
  }
}

}  // namespace unlidar
