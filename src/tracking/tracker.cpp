#include "tracking/tracker.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <set>
#include <utility>

#include "base/parallel.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/time_reversed.hpp"
#include "tracking/track_model.hpp"
#include "tracking/track_search.hpp"

namespace unlidar {
namespace {

// Searches for the paths through free plots, one for each agility.
std::vector<TrackSearch> SearchPlots(const std::vector<Plot>& plots,
                                     const std::vector<double>& log_births,
                                     const std::vector<Scan>& scans, const std::vector<char>& free,
                                     const ScanSchedule& scan_schedule,
                                     const TrackerConfig& config) {
  const std::vector<double>& sigmas = config.sigma_a_mps2;
  std::vector<std::optional<TrackSearch>> found(sigmas.size());
  ParallelFor(sigmas.size(), [&](std::size_t i) {
    found[i].emplace(plots, log_births, scans, free, TrackModel(sigmas[i], scan_schedule, config),
                     config);
  });
  std::vector<TrackSearch> searches;
  searches.reserve(found.size());
  for (std::optional<TrackSearch>& search : found) searches.push_back(std::move(*search));
  return searches;
}

Path BestOf(std::vector<TrackSearch>* searches) {
  Path best;
  for (TrackSearch& search : *searches) {
    Path path = search.Best();
    if (path.score > best.score) best = std::move(path);
  }
  return best;
}

class PathFinder {
 public:
  PathFinder(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
             const TrackerConfig& config)
      : plots_(plots),
        log_births_(LogBirths(plots, scan_schedule, config)),
        scans_(ScansOf(plots, log_births_, scan_schedule, config)),
        scan_schedule_(scan_schedule),
        config_(config),
        free_(plots.size(), 1) {}

  std::vector<Path> Find() {
    std::vector<Path> paths = ExtractPaths();
    const PathScorer scorer(plots_, log_births_, scan_schedule_, config_);
    for (Path& path : paths) path = scorer.WithScore(std::move(path.plots));
    for (bool changed = true; changed;) {
      const std::vector<Path> before = paths;
      effort_.pairs_compared += ImprovePaths(scorer, config_, &paths);
      changed = SearchAgain(before, &paths) || SearchInReverse(scorer, &paths);
    }
    return paths;
  }

  const Effort& effort() const { return effort_; }

 private:
  std::vector<TrackSearch> Search(const std::vector<char>& free) const {
    return SearchPlots(plots_, log_births_, scans_, free, scan_schedule_, config_);
  }

  void SetFree(const Path& path, char value) {
    for (const std::uint32_t i : path.plots) free_[i] = value;
  }

  // Most of what a search has found besides its best path stays true when that is taken away, so
  // paths are taken from one search until it holds no more; then what they hid is searched again.
  // However many targets there are; only of what is too weak for one there is a limit.
  std::vector<Path> ExtractPaths() {
    std::vector<Path> paths;
    int num_weak = 0;
    for (bool found = true; found;) {
      found = false;
      std::vector<TrackSearch> searches = Search(free_);
      while (true) {
        Path best = BestOf(&searches);
        if (best.score < config_.min_fragment_log) break;
        // What a weak path hides is weak, too.
        const bool exceeds_birth_cost = ExceedsBirthCost(best);
        if (!exceeds_birth_cost && num_weak == config_.max_paths) break;
        found = found || exceeds_birth_cost;
        if (!exceeds_birth_cost) ++num_weak;
        SetFree(best, 0);
        paths.push_back(std::move(best));
      }
    }
    return paths;
  }

  // Which free plots one target can have together with any of a path.
  std::vector<char> FreeInReach(const Path& path) const {
    const Plot& first = plots_[path.plots.front()];
    const Plot& last = plots_[path.plots.back()];
    constexpr double kSlack_m = 6.0;  // three positions may be off
    // Whichever of the path it is, the first one leads to it, and it to the last one.
    std::vector<char> free(plots_.size());
    for (std::size_t i = 0; i < plots_.size(); ++i) {
      free[i] = free_[i] && (IsInReach(first, plots_[i], kSlack_m, config_) ||
                             IsInReach(plots_[i], last, kSlack_m, config_));
    }
    return free;
  }

  // The best through what is free and what this path holds.
  Path BestInsteadOf(const Path& path) {
    SetFree(path, 1);
    const std::vector<char> free = FreeInReach(path);
    SetFree(path, 0);
    effort_.plots_searched_again +=
        static_cast<std::size_t>(std::count(free.begin(), free.end(), 1));
    std::vector<TrackSearch> searches = Search(free);
    return BestOf(&searches);
  }

  // The same, found from its end to its beginning.
  Path BestInReverse(const std::vector<char>& free, const PathScorer& scorer) const {
    std::vector<std::uint32_t> indices;
    std::vector<Plot> plots;
    std::vector<double> log_births;
    for (std::size_t i = free.size(); i-- > 0;) {
      if (!free[i]) continue;
      indices.push_back(static_cast<std::uint32_t>(i));
      plots.push_back(TimeReversed(plots_[i]));
      log_births.push_back(log_births_[i]);
    }
    const ScanSchedule scan_schedule = TimeReversed(scan_schedule_);
    const std::vector<char> all(plots.size(), 1);
    std::vector<TrackSearch> searches =
        SearchPlots(plots, log_births, ScansOf(plots, log_births, scan_schedule, config_), all,
                    scan_schedule, config_);
    std::vector<std::uint32_t> members;
    for (const std::uint32_t i : BestOf(&searches).plots) members.push_back(indices[i]);
    std::reverse(members.begin(), members.end());
    return scorer.WithScore(std::move(members));
  }

  // In rain too much begins at any time for all of it to be carried on: a target that was seldom
  // seen at first is lost there. Known from where it is seen well, it is followed back: no path is
  // cut short for it, however unlikely a pause after a few sightings.
  Path BestBackwardExtension(const Path& path, const PathScorer& scorer) {
    const auto backward_extension = [&](const std::vector<char>& free) {
      Path found = BestInReverse(free, scorer);
      const bool begins_later = !found.plots.empty() && found.plots.front() > path.plots.front();
      return begins_later ? Path() : found;
    };
    SetFree(path, 1);
    std::vector<char> free = FreeInReach(path);
    SetFree(path, 0);
    Path best = backward_extension(free);
    // Where only it is about until it began, nothing crowds out its way there.
    std::fill(free.begin() + path.plots.front(), free.end(), 0);
    for (const std::uint32_t i : path.plots) free[i] = 1;
    Path longer = backward_extension(free);
    if (longer.score > best.score) best = std::move(longer);
    return best;
  }

  // Whether no other path that exceeds_birth_cost shares its time: of what is free about one of
  // several, much is what the others have yet to be given.
  bool IsIsolated(const Path& path, const std::vector<Path>& paths) const {
    return std::none_of(paths.begin(), paths.end(), [&](const Path& other) {
      return &other != &path && ExceedsBirthCost(other) &&
             other.plots.front() <= path.plots.back() && path.plots.front() <= other.plots.back();
    });
  }

  bool ExceedsBirthCost(const Path& path) const { return path.score >= config_.birth_cost; }

  // Paths that differ from those before are searched again among what no other path holds but those
  // too weak to stand alone: their new parts may go on where the old ones could not.
  bool SearchAgain(const std::vector<Path>& before, std::vector<Path>* paths) {
    std::set<std::vector<std::uint32_t>> known;
    for (const Path& path : before) known.insert(path.plots);
    return Replace(paths, [&](const Path& path) {
      return known.count(path.plots) > 0 ? Path() : BestInsteadOf(path);
    });
  }

  bool SearchInReverse(const PathScorer& scorer, std::vector<Path>* paths) {
    return Replace(paths, [&](const Path& path) {
      return IsIsolated(path, *paths) ? BestBackwardExtension(path, scorer) : Path();
    });
  }

  // Replaces each path that exceeds_birth_cost alone by what `better` makes of it, if that is
  // better.
  template <typename Better>
  bool Replace(std::vector<Path>* paths, const Better& better) {
    std::fill(free_.begin(), free_.end(), 1);
    for (const Path& path : *paths) {
      if (ExceedsBirthCost(path)) SetFree(path, 0);
    }
    bool found = false;
    for (Path& path : *paths) {
      if (!ExceedsBirthCost(path)) continue;
      Path best = better(path);
      if (best.score <= path.score + config_.min_exchange_log) continue;
      SetFree(path, 1);
      path = std::move(best);
      SetFree(path, 0);
      found = true;
    }
    if (!found) return false;
    // A weak path that lost a plot is no more.
    paths->erase(std::remove_if(paths->begin(), paths->end(),
                                [&](const Path& path) {
                                  return !ExceedsBirthCost(path) &&
                                         std::any_of(path.plots.begin(), path.plots.end(),
                                                     [&](std::uint32_t i) { return !free_[i]; });
                                }),
                 paths->end());
    return true;
  }

  const std::vector<Plot>& plots_;
  std::vector<double> log_births_;
  std::vector<Scan> scans_;
  ScanSchedule scan_schedule_;
  const TrackerConfig& config_;
  std::vector<char> free_;  // plots that no path holds
  Effort effort_;
};

}  // namespace

std::vector<Path> FindPaths(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                            const TrackerConfig& config, Effort* effort) {
  PathFinder finder(plots, scan_schedule, config);
  std::vector<Path> paths = finder.Find();
  if (effort != nullptr) *effort = finder.effort();
  std::stable_sort(paths.begin(), paths.end(),
                   [](const Path& a, const Path& b) { return a.score > b.score; });
  return paths;
}

}  // namespace unlidar
