#include "robust/tracking/path_exchange.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <limits>
#include <utility>

#include "robust/tracking/track_model.hpp"

namespace unlidar {
namespace {

using Members = std::vector<std::uint32_t>;

// Whether what comes before a cut of one path can go on as what comes after a cut of the other.
bool IsReachable(const std::vector<Plot>& plots, const Members& from,
                 Members::const_iterator cut_from, const Members& to,
                 Members::const_iterator cut_to, const TrackerConfig& config) {
  if (cut_from == from.begin() || cut_to == to.end()) return true;
  const Plot& a = plots[*(cut_from - 1)];
  const Plot& b = plots[*cut_to];
  const double dt = static_cast<double>(b.time_ns - a.time_ns) * kSecondsPerNs;
  constexpr double kSlack_m = 2.0;
  return (b.position_m - a.position_m).norm() < config.max_speed_mps * dt + kSlack_m;
}

bool IsTooShort(const Path& path, const TrackerConfig& config) {
  return path.plots.size() < static_cast<std::size_t>(config.min_fragment_plots);
}

// The best that two paths can become by joining them or by exchanging what follows some time. A
// path costs `birth_cost`, an empty one nothing.
bool Exchange(const PathScorer& scorer, const TrackerConfig& config, Path* a, Path* b) {
  // What is too weak to stand alone is worth nothing.
  const auto value = [&](const Path& path) {
    return IsTooShort(path, config) ? 0.0 : std::max(0.0, path.score - config.birth_cost);
  };
  double best = value(*a) + value(*b) + config.min_exchange_log;
  Path best_a;
  Path best_b;
  const auto consider = [&](Members first, Members second) {
    Path p = scorer.Scored(std::move(first));
    Path q = scorer.Scored(std::move(second));
    if (value(p) + value(q) <= best) return;
    best = value(p) + value(q);
    best_a = std::move(p);
    best_b = std::move(q);
  };
  Members all;
  std::set_union(a->plots.begin(), a->plots.end(), b->plots.begin(), b->plots.end(),
                 std::back_inserter(all));
  consider(all, {});
  // Where the next plot is of the same path for a while, a cut only moves that path's plots to the
  // other. Near a change it may leave a stray first or last plot behind.
  constexpr std::size_t kReach = 2;
  const auto in_a = [&](std::size_t k) {
    return std::binary_search(a->plots.begin(), a->plots.end(), all[k]);
  };
  std::vector<char> is_cut(all.size(), 0);
  for (std::size_t k = 1; k < all.size(); ++k) {
    if (in_a(k) == in_a(k - 1)) continue;
    const std::size_t last = std::min(k + kReach, all.size() - 1);
    for (std::size_t j = k - std::min(k - 1, kReach); j <= last; ++j) is_cut[j] = 1;
  }
  for (std::size_t k = 1; k < all.size(); ++k) {
    if (!is_cut[k]) continue;
    const auto cut_a = std::lower_bound(a->plots.cbegin(), a->plots.cend(), all[k]);
    const auto cut_b = std::lower_bound(b->plots.cbegin(), b->plots.cend(), all[k]);
    if (!IsReachable(scorer.plots(), a->plots, cut_a, b->plots, cut_b, config) ||
        !IsReachable(scorer.plots(), b->plots, cut_b, a->plots, cut_a, config)) {
      continue;
    }
    Members first(a->plots.cbegin(), cut_a);
    Members second(b->plots.cbegin(), cut_b);
    first.insert(first.end(), cut_b, b->plots.cend());
    second.insert(second.end(), cut_a, a->plots.cend());
    consider(std::move(first), std::move(second));
  }
  if (best_a.plots.empty() && best_b.plots.empty()) return false;
  *a = std::move(best_a);
  *b = std::move(best_b);
  return true;
}

// Drops the few plots that stand between two pauses, or before the first or after the last one,
// where the path is better without: a search that allows no longer gap had to step on them.
bool Prune(const PathScorer& scorer, const TrackerConfig& config, Path* path) {
  constexpr TimeNs kPause_ns = 500'000'000;
  constexpr std::size_t kMaxPlots = 6;
  const std::vector<Plot>& plots = scorer.plots();
  Path best = *path;
  for (std::size_t first = 0; first < path->plots.size();) {
    std::size_t last = first + 1;
    while (last < path->plots.size() &&
           plots[path->plots[last]].time_ns - plots[path->plots[last - 1]].time_ns < kPause_ns) {
      ++last;
    }
    if (last - first <= kMaxPlots && last - first < path->plots.size()) {
      Members rest(path->plots.begin(), path->plots.begin() + static_cast<std::ptrdiff_t>(first));
      rest.insert(rest.end(), path->plots.begin() + static_cast<std::ptrdiff_t>(last),
                  path->plots.end());
      Path pruned = scorer.Scored(std::move(rest));
      if (pruned.score > best.score) best = std::move(pruned);
    }
    first = last;
  }
  if (best.score <= path->score + config.min_exchange_log) return false;
  *path = std::move(best);
  return true;
}

}  // namespace

Path PathScorer::Scored(Members members) const {
  Path path;
  path.plots = std::move(members);
  if (path.plots.empty()) return path;
  const std::size_t birth = path.plots.front();
  path.score = -std::numeric_limits<double>::infinity();
  std::vector<Moment> moments;
  for (std::size_t k = 0; k < path.plots.size(); ++k) {
    const Plot& plot = plots_[path.plots[k]];
    if (k > 0 && plot.frame == plots_[path.plots[k - 1]].frame) return path;
    moments.push_back(MomentOf(plot, plots_.front(), watch_));
  }
  for (const double sigma : config_.sigma_a_mps2) {
    const TrackModel model(sigma, watch_, config_);
    for (const double speed_mps : config_.birth_speeds_mps) {
      Hypothesis h = model.Birth(plots_[birth], log_births_[birth], moments.front(), speed_mps);
      for (std::size_t k = 1; k < path.plots.size(); ++k) {
        const Plot& plot = plots_[path.plots[k]];
        const Motion motion = model.MotionOver(moments[k].time_s - h.time_s);
        const Prediction p = model.Predict(h, model.ScoreUnseen(h, moments[k]), motion);
        h = model.Update(h, motion, p, plot, moments[k], model.GainOf(p, plot));
      }
      path.score = std::max(path.score, h.score);
    }
  }
  return path;
}

void ImprovePaths(const PathScorer& scorer, const TrackerConfig& config, std::vector<Path>* paths) {
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t i = 0; i < paths->size(); ++i) {
      for (std::size_t j = i + 1; j < paths->size(); ++j) {
        Path& a = (*paths)[i];
        Path& b = (*paths)[j];
        if (!a.plots.empty() && !b.plots.empty()) {
          changed |= Exchange(scorer, config, &a, &b);
        }
      }
    }
    for (Path& path : *paths) {
      if (!path.plots.empty()) changed |= Prune(scorer, config, &path);
    }
  }
  paths->erase(std::remove_if(paths->begin(), paths->end(),
                              [&](const Path& path) { return IsTooShort(path, config); }),
               paths->end());
}

}  // namespace unlidar
