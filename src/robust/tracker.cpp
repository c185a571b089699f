#include "unlidar/robust/tracker.hpp"

#include <algorithm>
#include <iterator>

#include "path_exchange.hpp"
#include "track_model.hpp"
#include "track_search.hpp"

namespace unlidar {
namespace {

// Most of what a search has found besides its best path stays true when that is taken away, so
// paths are taken from one search until it holds no more; then what they hid is searched again.
std::vector<Path> TakeBestPaths(const std::vector<Plot>& plots,
                                const std::vector<double>& log_births, double period_s,
                                const TrackerConfig& config) {
  std::vector<Path> paths;
  std::vector<char> free(plots.size(), 1);
  const auto max_paths = static_cast<std::size_t>(config.max_paths);
  for (bool found = true; found && paths.size() < max_paths;) {
    found = false;
    std::vector<TrackSearch> searches;
    for (const double sigma : config.sigma_a_mps2) {
      searches.emplace_back(plots, log_births, free, TrackModel(sigma, period_s, config), config);
    }
    while (paths.size() < max_paths) {
      Path best;
      for (const TrackSearch& search : searches) {
        Path path = search.Best();
        if (path.score > best.score) best = std::move(path);
      }
      if (best.score < config.min_fragment_log) break;
      for (const std::uint32_t i : best.plots) free[i] = 0;
      paths.push_back(std::move(best));
      found = true;
    }
  }
  return paths;
}

}  // namespace

std::vector<Path> FindPaths(const std::vector<Plot>& plots, double period_s,
                            const TrackerConfig& config) {
  const std::vector<double> log_births = LogBirths(plots, config);
  std::vector<Path> paths = TakeBestPaths(plots, log_births, period_s, config);
  ImprovePaths(PathScorer(plots, log_births, period_s, config), config, &paths);
  std::stable_sort(paths.begin(), paths.end(),
                   [](const Path& a, const Path& b) { return a.score > b.score; });
  return paths;
}

}  // namespace unlidar
