// Crowding: other plots near a path while it lasts.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "scene/clutter.hpp"
#include "scene/plots.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {

// Other plots count within this time of a plot: the clutter intensity is that of other times.
constexpr double kCrowdingReachS = (ClutterMap::kExclusionBins + 0.5) * kBinS;

// Returns the log-likelihood penalty for clutter that crowds about a path. The clutter intensity is
// the mean of other times, as of a Poisson process, but a bush in a gust, or a person behind a
// hedge, shows all at once: so the other plots around each plot at the same time count, and so do
// bursts at its very spot, where a twig that sways comes and goes. Given one plot of such clutter
// (its Palm distribution), those within kCrowdingReachS of it are expected, not the mean. Plots of
// targets, which are not free, and its own do not count.
// `num_frames_about`: number of frames of the sensor of a plot within kCrowdingReachS.
double CrowdingPenalty(const std::vector<std::uint32_t>& path, const std::vector<Plot>& plots,
                       const std::vector<char>& are_free,
                       const std::function<std::uint32_t(const Plot&)>& num_frames_about);

}  // namespace unlidar
