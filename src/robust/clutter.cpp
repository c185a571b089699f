#include <algorithm>
#include <cmath>

#include "unlidar/robust/plots.hpp"

namespace unlidar {
namespace {

// The volume in which the plots of one point-like thing lie: that of a Gaussian of their noise.
double PlotVolumeM3(const Plot& plot) {
  return std::pow(2.0 * M_PI * std::exp(1.0) * plot.variance_m2, 1.5);
}

}  // namespace

void EstimateClutter(const Recording& recording, const Background& background,
                     const PlotConfig& config, const std::vector<char>& explained,
                     std::vector<Plot>* plots) {
  // From wide to narrow: each level is the prior of the next, so that an empty neighbourhood still
  // has the rate of its surroundings, and a rate is believed only as far as its exposure goes.
  const std::size_t num_bins = background.num_bins();
  const std::vector<double>& frames_in_bin = background.frames_in_bin();
  const auto bin_of = [&](const Plot& plot) { return background.BinOf(plot.time_ns); };

  const auto exclusion = static_cast<std::size_t>(config.clutter_exclusion_bins);
  std::vector<double> rate(plots->size(), 1e-6);
  std::vector<std::uint32_t> profile(num_bins);
  for (const RangeRadius& radius :
       {config.clutter_wide, config.clutter_middle, config.clutter_narrow}) {
    RangeGrid grid(radius, num_bins);
    for (std::size_t i = 0; i < plots->size(); ++i) {
      if (!explained[i]) grid.Add((*plots)[i].position_m.cast<float>(), bin_of((*plots)[i]));
    }
    for (std::size_t i = 0; i < plots->size(); ++i) {
      const Plot& plot = (*plots)[i];
      std::fill(profile.begin(), profile.end(), 0);
      grid.Collect(plot.position_m.cast<float>(), &profile);
      const std::size_t own = bin_of(plot);
      double count = 0.0;
      double frames = 0.0;
      for (std::size_t b = 0; b < num_bins; ++b) {
        if (std::max(b, own) - std::min(b, own) <= exclusion) continue;
        count += profile[b];
        frames += frames_in_bin[b];
      }
      const double exposure = frames * grid.VolumeM3(plot.position_m.cast<float>());
      rate[i] =
          (count + config.clutter_prior_plots) / (exposure + config.clutter_prior_plots / rate[i]);
    }
  }
  // A static thing that is seldom hit would give the plots of its place at the rate at which they
  // came, the plot itself left out.
  const auto num_frames = static_cast<double>(recording.frames.size());
  RangeGrid spots(config.spot, 1);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    if (!explained[i]) spots.Add((*plots)[i].position_m.cast<float>(), 0);
  }
  std::vector<std::uint32_t> num_plots(1);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.log_clutter = std::log(rate[i]);
    if (plot.is_floating) continue;
    num_plots[0] = 0;
    spots.Collect(plot.position_m.cast<float>(), &num_plots);
    const double spot_rate =
        (num_plots[0] - (explained[i] ? 0.0 : 1.0)) / num_frames / PlotVolumeM3(plot);
    if (spot_rate > rate[i]) plot.log_clutter = std::log(spot_rate);
  }
}

}  // namespace unlidar
