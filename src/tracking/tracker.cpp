#include "tracking/tracker.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

#include "base/algorithms.hpp"
#include "base/parallel.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/track_model.hpp"
#include "tracking/track_search.hpp"

namespace unlidar {
namespace {

// Paths below kInitiationLog cannot be targets, but their ends may be parts of one: that many are
// kept for exchanges, none whose score clutter reaches often.
constexpr int kMaxWeakPaths = 20;
constexpr double kMinWeakPathLog = 7.0;

// Searches through the same plots, one per sigma_a.
using TrackSearches = std::vector<std::optional<TrackSearch>>;

// Searches the free plots for paths above `min_score` with each of these sigma_a.
TrackSearches SearchScans(const std::vector<Scan>& scans, const std::vector<double>& log_births,
                          const std::vector<char>& free, double min_score,
                          const std::vector<double>& sigmas, const ScanSchedule& scan_schedule,
                          const TrackerConfig& config) {
  TrackSearches searches(sigmas.size());
  ParallelFor(sigmas.size(), [&](std::size_t i) {
    searches[i].emplace(log_births, scans, free, min_score,
                        TrackModel(sigmas[i], scan_schedule, config), config);
  });
  return searches;
}

Path BestOf(TrackSearches* searches) {
  Path best;
  for (std::optional<TrackSearch>& search : *searches) {
    Path path = search->Best();
    if (path.score > best.score) best = std::move(path);
  }
  return best;
}

class PathFinder {
 public:
  // `is_rough`: see FindPathsRoughly().
  PathFinder(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
             const TrackerConfig& config, bool is_rough)
      : plots_(plots),
        log_births_(LogBirths(plots, scan_schedule, config)),
        scans_(ScansOf(plots, log_births_, scan_schedule)),
        scan_schedule_(scan_schedule),
        config_(config),
        is_rough_(is_rough),
        free_(plots.size(), 1) {}

  std::vector<Path> Find() {
    std::vector<Path> paths = ExtractPaths();
    const PathScorer scorer = Scorer(TimeOutOfView::kNone);
    SetScores(scorer, &paths);
    for (bool changed = true; changed;) {
      const std::vector<Path> before = paths;
      effort_.pairs_compared += ImprovePaths(scorer, config_, &paths);
      changed = !is_rough_ && (SearchAgain(before, &paths) || SearchInReverse(scorer, &paths));
    }
    const PathScorer judge = Scorer(TimeOutOfView::kLogUniform);
    SetScores(judge, &paths);
    effort_.pairs_compared += ImprovePaths(judge, config_, &paths);
    std::stable_sort(paths.begin(), paths.end(),
                     [](const Path& a, const Path& b) { return a.score > b.score; });
    return paths;
  }

  const Effort& effort() const { return effort_; }

 private:
  PathScorer Scorer(TimeOutOfView time_out_of_view) const {
    return PathScorer(plots_, log_births_, scan_schedule_, config_, time_out_of_view);
  }

  static void SetScores(const PathScorer& scorer, std::vector<Path>* paths) {
    for (Path& path : *paths) path = scorer.WithScore(std::move(path.plots));
  }

  TrackSearches Search(const std::vector<char>& free, double min_score,
                       const std::vector<double>& sigmas) const {
    return SearchScans(scans_, log_births_, free, min_score, sigmas, scan_schedule_, config_);
  }

  // Searches the free plots, roughly with the median sigma_a alone. The rest that earlier searches
  // have left is mostly clutter, so all sigma_a search it only if that one finds a strong path.
  TrackSearches SearchFree(bool is_rest) const {
    if (is_rough_ || is_rest) {
      const std::vector<double> sigmas = SortedUnique(config_.sigma_a_mps2);
      TrackSearches searches = Search(free_, kMinWeakPathLog, {sigmas[sigmas.size() / 2]});
      if (is_rough_ || !IsStrong(BestOf(&searches))) return searches;
    }
    return Search(free_, kMinWeakPathLog, config_.sigma_a_mps2);
  }

  void SetFree(const Path& path, char value) {
    for (const std::uint32_t i : path.plots) free_[i] = value;
  }

  // Removing the best path of a search leaves most of its other paths valid, so paths are taken
  // from one search until none is left; then the remaining plots are searched again. Only the
  // number of paths below kInitiationLog is limited.
  std::vector<Path> ExtractPaths() {
    std::vector<Path> paths;
    int num_weak = 0;
    for (bool found = true; found;) {
      found = false;
      TrackSearches searches = SearchFree(!paths.empty());
      for (Path best = BestOf(&searches); !best.plots.empty(); best = BestOf(&searches)) {
        // A path hidden by a weak one is weak, too.
        if (!IsStrong(best) && ++num_weak > kMaxWeakPaths) break;
        found = found || IsStrong(best);
        SetFree(best, 0);
        paths.push_back(std::move(best));
      }
    }
    return paths;
  }

  // The plots of a path, and free ones that a target could share with some plot of it.
  std::vector<char> FreeInReach(const Path& path) {
    SetFree(path, 1);
    const Plot& first = plots_[path.plots.front()];
    const Plot& last = plots_[path.plots.back()];
    constexpr double kSlackM = 3.0 * kReachSlackM;  // errors of three positions
    // Any plot of the path is reachable from the first one and reaches the last one.
    std::vector<char> free(plots_.size());
    for (std::size_t i = 0; i < plots_.size(); ++i) {
      free[i] = free_[i] && (IsInReach(first, plots_[i], kSlackM, config_) ||
                             IsInReach(plots_[i], last, kSlackM, config_));
    }
    SetFree(path, 0);
    return free;
  }

  // Best path through the free plots and those of this path, if it scores higher.
  Path BestReplacement(const Path& path) {
    const std::vector<char> free = FreeInReach(path);
    effort_.plots_searched_again +=
        static_cast<std::size_t>(std::count(free.begin(), free.end(), 1));
    TrackSearches searches = Search(free, path.score, config_.sigma_a_mps2);
    return BestOf(&searches);
  }

  // Same, searched in reversed time.
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
    TrackSearches searches = SearchScans(ScansOf(plots, log_births, scan_schedule), log_births, all,
                                         0.0, config_.sigma_a_mps2, scan_schedule, config_);
    Members members = ValuesAt(BestOf(&searches).plots, indices);
    std::reverse(members.begin(), members.end());
    return scorer.WithScore(std::move(members));
  }

  // In rain there are too many births to carry all hypotheses on, so a target that is seldom seen
  // at first is lost. It is followed back from where it is seen well: in reversed time no
  // continuation is dropped for a pause after few detections.
  Path BestBackwardExtension(const Path& path, const PathScorer& scorer) {
    std::vector<char> free = FreeInReach(path);
    // Only its own plots after its first one: no other hypothesis displaces it there.
    std::fill(free.begin() + path.plots.front(), free.end(), 0);
    for (const std::uint32_t i : path.plots) free[i] = 1;
    Path found = BestInReverse(free, scorer);
    const bool begins_later = !found.plots.empty() && found.plots.front() > path.plots.front();
    return begins_later ? Path() : found;
  }

  // True if no other path above kInitiationLog overlaps it in time. Between overlapping paths, many
  // free plots still belong to the others.
  bool IsIsolated(const Path& path, const std::vector<Path>& paths) const {
    return std::none_of(paths.begin(), paths.end(), [&](const Path& other) {
      return &other != &path && IsStrong(other) && other.plots.front() <= path.plots.back() &&
             path.plots.front() <= other.plots.back();
    });
  }

  static bool IsStrong(const Path& path) { return path.score >= kInitiationLog; }

  // Searches each changed path again, among its plots and all that no other path above
  // kInitiationLog holds: its new part may continue where the old one could not.
  bool SearchAgain(const std::vector<Path>& before, std::vector<Path>* paths) {
    std::set<Members> known;
    for (const Path& path : before) known.insert(path.plots);
    return Replace(paths, [&](const Path& path) {
      return known.count(path.plots) > 0 ? Path() : BestReplacement(path);
    });
  }

  bool SearchInReverse(const PathScorer& scorer, std::vector<Path>* paths) {
    return Replace(paths, [&](const Path& path) {
      return IsIsolated(path, *paths) ? BestBackwardExtension(path, scorer) : Path();
    });
  }

  // Replaces each path above kInitiationLog by the result of `better`, if that scores higher.
  template <typename Better>
  bool Replace(std::vector<Path>* paths, const Better& better) {
    std::fill(free_.begin(), free_.end(), 1);
    for (const Path& path : *paths) {
      if (IsStrong(path)) SetFree(path, 0);
    }
    bool found = false;
    for (Path& path : *paths) {
      if (!IsStrong(path)) continue;
      Path best = better(path);
      if (best.score <= path.score + kMinExchangeLog) continue;
      SetFree(path, 1);
      path = std::move(best);
      SetFree(path, 0);
      found = true;
    }
    // Weak paths that lost a plot are removed.
    EraseIf(paths, [&](const Path& path) {
      return found && !IsStrong(path) &&
             std::any_of(path.plots.begin(), path.plots.end(),
                         [&](std::uint32_t i) { return !free_[i]; });
    });
    return found;
  }

  const std::vector<Plot>& plots_;
  std::vector<double> log_births_;
  std::vector<Scan> scans_;
  ScanSchedule scan_schedule_;
  const TrackerConfig& config_;
  bool is_rough_;
  std::vector<char> free_;  // (plots) not held by a path
  Effort effort_;
};

}  // namespace

// A track score is a log likelihood ratio weighted by the birth density of its first plot. By
// Ville's inequality clutter exceeds e^s, in a search with one model, with a probability of at most
// e^-s.
double ScoreThreshold(double num_plots, double false_alarms, const TrackerConfig& config) {
  const auto num_models =
      static_cast<double>(config.sigma_a_mps2.size() * config.birth_speeds_mps.size());
  return std::log(num_plots * num_models / false_alarms);
}

std::vector<Path> FindPaths(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                            const TrackerConfig& config, Effort* effort) {
  PathFinder finder(plots, scan_schedule, config, false);
  std::vector<Path> paths = finder.Find();
  if (effort != nullptr) *effort = finder.effort();
  return paths;
}

std::vector<Path> FindPathsRoughly(const std::vector<Plot>& plots,
                                   const ScanSchedule& scan_schedule, const TrackerConfig& config) {
  return PathFinder(plots, scan_schedule, config, true).Find();
}

}  // namespace unlidar
