#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <unordered_map>
#include <vector>

#include "unlidar/robust/plots.hpp"

namespace unlidar {
namespace {

// The volume in which the plots of one point-like thing lie: that of a Gaussian of their noise.
double PlotVolumeM3(const Plot& plot) {
  return std::pow(2.0 * M_PI * std::exp(1.0) * plot.variance_m2, 1.5);
}

// Mean over the returns of a plot.
double PlaceRate(const Plot& plot, const Background& background) {
  double sum = 0.0;
  for (const std::uint32_t i : plot.returns) sum += background.PlaceRate(i);
  return sum / static_cast<double>(plot.returns.size());
}

// Plots per place and time bin. Those at one place share their neighbourhood, so it is summed once
// for all of them: in rain there are many. All are added before the first is counted.
class PlotGrid {
 public:
  PlotGrid(RangeRadius radius, std::size_t num_bins) : grid_(radius, num_bins) {}

  void Add(const Plot& plot, std::size_t bin) { grid_.Add(plot.position_m.cast<float>(), bin); }

  // In the neighbourhood of a plot over all bins.
  std::uint32_t Count(const Plot& plot) { return CountsBefore(plot)[grid_.num_bins()]; }

  // The same without the bins of [first, last).
  std::uint32_t CountOutside(const Plot& plot, std::size_t first, std::size_t last) {
    const std::uint32_t* before = CountsBefore(plot);
    return before[grid_.num_bins()] - (before[last] - before[first]);
  }

  double VolumeM3(const Plot& plot) const { return grid_.VolumeM3(plot.position_m.cast<float>()); }

 private:
  // Up to, and without, each bin, and of all: (num_bins + 1).
  const std::uint32_t* CountsBefore(const Plot& plot) {
    const Eigen::Vector3f place_m = plot.position_m.cast<float>();
    const auto [row, is_new] = rows_.try_emplace(grid_.Key(place_m), counts_.size());
    if (is_new) {
      profile_.assign(grid_.num_bins(), 0);
      grid_.Collect(place_m, &profile_);
      std::uint32_t sum = 0;
      counts_.push_back(sum);
      for (const std::uint32_t count : profile_) counts_.push_back(sum += count);
    }
    return &counts_[row->second];
  }

  RangeGrid grid_;
  std::vector<std::uint32_t> profile_;
  std::unordered_map<std::uint64_t, std::size_t> rows_;  // of a place: where its counts begin
  std::vector<std::uint32_t> counts_;
};

}  // namespace

void EstimateClutter(const Background& background, const PlotConfig& config,
                     const std::vector<char>& explained, std::vector<Plot>* plots) {
  const std::size_t num_bins = background.num_bins();
  const std::vector<std::vector<double>>& frames_in_bin = background.frames_in_bin();
  const std::size_t num_sensors = frames_in_bin.size();
  std::vector<double> num_frames;
  num_frames.reserve(num_sensors);
  for (const std::vector<double>& in_bin : frames_in_bin) {
    num_frames.push_back(std::accumulate(in_bin.begin(), in_bin.end(), 0.0));
  }

  std::vector<std::size_t> bins;
  for (const Plot& plot : *plots) bins.push_back(background.BinOf(plot.time_ns));

  // From wide to narrow: each level is the prior of the next, so that an empty neighbourhood still
  // has the rate of its surroundings, and a rate is believed only as far as its exposure goes.
  std::vector<double> rate(plots->size(), 1e-6);
  const auto exclusion = static_cast<std::size_t>(config.clutter_exclusion_bins);
  for (const RangeRadius& radius :
       {config.clutter_wide, config.clutter_middle, config.clutter_narrow}) {
    std::vector<PlotGrid> grids(num_sensors, PlotGrid(radius, num_bins));
    for (std::size_t i = 0; i < plots->size(); ++i) {
      const Plot& plot = (*plots)[i];
      if (!explained[i]) grids[plot.sensor].Add(plot, bins[i]);
    }
    for (std::size_t i = 0; i < plots->size(); ++i) {
      const Plot& plot = (*plots)[i];
      const std::size_t first = bins[i] - std::min(bins[i], exclusion);
      const std::size_t last = std::min(bins[i] + exclusion + 1, num_bins);
      double frames = num_frames[plot.sensor];
      for (std::size_t b = first; b < last; ++b) frames -= frames_in_bin[plot.sensor][b];
      PlotGrid& grid = grids[plot.sensor];
      const double exposure = frames * grid.VolumeM3(plot);
      rate[i] = (grid.CountOutside(plot, first, last) + config.clutter_prior_plots) /
                (exposure + config.clutter_prior_plots / rate[i]);
    }
  }
  // A static thing that is seldom hit would give the plots of its place at the rate at which they
  // came, the plot itself left out.
  std::vector<PlotGrid> spots(num_sensors, PlotGrid(config.spot, 1));
  for (std::size_t i = 0; i < plots->size(); ++i) {
    if (!explained[i]) spots[(*plots)[i].sensor].Add((*plots)[i], 0);
  }
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.log_clutter = std::log(rate[i]);
    if (plot.is_floating) continue;
    const double others = spots[plot.sensor].Count(plot) - (explained[i] ? 0.0 : 1.0);
    const double spot_rate = others / num_frames[plot.sensor] / PlotVolumeM3(plot);
    // A target that was found may have come back to its own place.
    const double place_rate = explained[i] ? 0.0 : PlaceRate(plot, background);
    plot.log_clutter = std::log(std::max({rate[i], spot_rate, place_rate}));
  }
}

}  // namespace unlidar
