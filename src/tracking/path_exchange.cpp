#include "tracking/path_exchange.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <iterator>
#include <limits>
#include <optional>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

struct Extent {
  Eigen::AlignedBox3d box_m;
  TimeNs first_ns = std::numeric_limits<TimeNs>::max();
  TimeNs last_ns = std::numeric_limits<TimeNs>::min();
};

Extent ExtentOf(const std::vector<Plot>& plots, const Path& path) {
  Extent extent;
  for (const std::uint32_t i : path.plots) {
    extent.box_m.extend(plots[i].position_m);
    extent.first_ns = std::min(extent.first_ns, plots[i].time_ns);
    extent.last_ns = std::max(extent.last_ns, plots[i].time_ns);
  }
  return extent;
}

// False only if no plot of one path is reachable from any of the other.
bool MayInteract(const Extent& a, const Extent& b, const TrackerConfig& config) {
  const TimeNs max_interval_ns = std::max(a.last_ns - b.first_ns, b.last_ns - a.first_ns);
  const double reach_m = config.max_speed_mps * SecondsOf(max_interval_ns) + kReachSlackM;
  return a.box_m.squaredExteriorDistance(b.box_m) <= reach_m * reach_m;
}

// Numbers of plots of two paths before a time.
struct Cut {
  std::size_t in_a = 0;
  std::size_t in_b = 0;
};

// True if the first `num_before` plots of `from` can continue as the plots of `to` after the first
// `num_skipped`.
bool IsReachable(const std::vector<Plot>& plots, const Members& from, std::size_t num_before,
                 const Members& to, std::size_t num_skipped, const TrackerConfig& config) {
  if (num_before == 0 || num_skipped == to.size()) return true;
  return IsInReach(plots[from[num_before - 1]], plots[to[num_skipped]], kReachSlackM, config);
}

// Times at which two paths may exchange tails: those near a change from plots of one path to plots
// of the other. Elsewhere a cut only moves plots of one path to the other. Near a change it may
// leave a stray first or last plot behind.
std::vector<Cut> CutsOf(const std::vector<Plot>& plots, const Members& a, const Members& b,
                        const TrackerConfig& config) {
  constexpr std::size_t kReach = 2;
  std::vector<char> is_of_a;  // (plots of both, by time)
  is_of_a.reserve(a.size() + b.size());
  for (Cut at; at.in_a + at.in_b < a.size() + b.size();) {
    is_of_a.push_back(at.in_b == b.size() || (at.in_a < a.size() && a[at.in_a] < b[at.in_b]));
    ++(is_of_a.back() ? at.in_a : at.in_b);
  }
  std::vector<char> is_cut(is_of_a.size(), 0);
  for (std::size_t k = 1; k < is_of_a.size(); ++k) {
    if (is_of_a[k] == is_of_a[k - 1]) continue;
    const std::size_t last = std::min(k + kReach, is_of_a.size() - 1);
    for (std::size_t j = k - std::min(k - 1, kReach); j <= last; ++j) is_cut[j] = 1;
  }
  std::vector<Cut> cuts;
  Cut at;
  for (std::size_t k = 0; k < is_of_a.size(); ++k) {
    if (is_cut[k] && IsReachable(plots, a, at.in_a, b, at.in_b, config) &&
        IsReachable(plots, b, at.in_b, a, at.in_a, config)) {
      cuts.push_back(at);
    }
    ++(is_of_a[k] ? at.in_a : at.in_b);
  }
  return cuts;
}

bool IsTooShort(const Path& path) {
  return path.plots.size() < static_cast<std::size_t>(kMinPathPlots);
}

// A path costs kInitiationLog, an empty one nothing. Paths that are too short or too weak have no
// value.
double ValueOf(const Path& path) {
  return IsTooShort(path) ? 0.0 : std::max(0.0, path.score - kInitiationLog);
}

// Returns a hypothesis, then that after each further plot of a path, from number `first` on.
std::vector<Hypothesis> FilterFrom(const TrackModel& model, const Hypothesis& from,
                                   const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, std::size_t first) {
  std::vector<Hypothesis> hypotheses;
  hypotheses.reserve(plots.size() - first + 1);
  hypotheses.push_back(from);
  for (std::size_t k = first; k < plots.size(); ++k) {
    hypotheses.push_back(model.PredictAndUpdate(hypotheses.back(), *plots[k], frame_times[k]));
  }
  return hypotheses;
}

// Joins two paths or exchanges their tails where the sum of their values grows most. Returns true
// if the paths changed.
bool Exchange(const PathScorer& scorer, const TrackerConfig& config, Path* a, Path* b) {
  double best = ValueOf(*a) + ValueOf(*b) + kMinExchangeLog;
  Path best_a;
  Path best_b;
  const auto consider = [&](Path p, Path q) {
    if (ValueOf(p) + ValueOf(q) <= best) return;
    best = ValueOf(p) + ValueOf(q);
    best_a = std::move(p);
    best_b = std::move(q);
  };
  Members all;
  std::set_union(a->plots.begin(), a->plots.end(), b->plots.begin(), b->plots.end(),
                 std::back_inserter(all));
  consider(scorer.WithScore(std::move(all)), {});
  const std::vector<Cut> cuts = CutsOf(scorer.plots(), a->plots, b->plots, config);
  if (!cuts.empty()) {
    const PathScorer::Filtered of_a = scorer.Filter(a->plots);
    const PathScorer::Filtered of_b = scorer.Filter(b->plots);
    for (const Cut& cut : cuts) {
      consider(scorer.WithScore(of_a, cut.in_a, of_b, cut.in_b),
               scorer.WithScore(of_b, cut.in_b, of_a, cut.in_a));
    }
  }
  if (best_a.plots.empty() && best_b.plots.empty()) return false;
  *a = std::move(best_a);
  *b = std::move(best_b);
  return true;
}

}  // namespace

std::vector<Hypothesis> FilterPath(const TrackModel& model, const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, double log_birth,
                                   const TrackerConfig& config) {
  std::vector<Hypothesis> best;
  for (const double speed_mps : config.birth_speeds_mps) {
    const Hypothesis birth = model.Birth(*plots.front(), log_birth, frame_times.front(), speed_mps);
    std::vector<Hypothesis> hypotheses = FilterFrom(model, birth, plots, frame_times, 1);
    if (best.empty() || hypotheses.back().score > best.back().score) best = std::move(hypotheses);
  }
  return best;
}

PathScorer::PathScorer(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                       const ScanSchedule& scan_schedule, const TrackerConfig& config,
                       TimeOutOfView time_out_of_view)
    : PathScorer(
          plots, log_births, {},
          [&plots, scan_schedule](const Plot& plot) {
            return FrameTimeOf(plot, plots.front().frame_time_ns, scan_schedule);
          },
          config) {
  for (const double sigma : config.sigma_a_mps2) {
    models_.emplace_back(sigma, scan_schedule, config, time_out_of_view);
  }
}

Path PathScorer::WithScore(Members members) const {
  Path path;
  path.plots = std::move(members);
  if (path.plots.empty()) return path;
  path.score = -std::numeric_limits<double>::infinity();
  for (std::size_t k = 1; k < path.plots.size(); ++k) {
    if (plots_[path.plots[k]].frame == plots_[path.plots[k - 1]].frame) return path;
  }
  for (const std::vector<Hypothesis>& hypotheses : Filter(path.plots).hypotheses) {
    path.score = std::max(path.score, hypotheses.back().score);
  }
  return path;
}

PathScorer::Filtered PathScorer::Filter(const Members& members) const {
  Filtered path;
  path.members = members;
  for (const std::uint32_t i : members) {
    path.plots.push_back(&plots_[i]);
    path.frame_times.push_back(frame_time_of_(plots_[i]));
  }
  for (const TrackModel& model : models_) {
    for (const double speed_mps : config_.birth_speeds_mps) {
      const Hypothesis birth = model.Birth(*path.plots.front(), log_births_[members.front()],
                                           path.frame_times.front(), speed_mps);
      path.hypotheses.push_back(FilterFrom(model, birth, path.plots, path.frame_times, 1));
    }
  }
  return path;
}

Path PathScorer::WithScore(const Filtered& head, std::size_t num_of_head, const Filtered& tail,
                           std::size_t num_skipped) const {
  Path path;
  path.plots.assign(head.members.begin(),
                    head.members.begin() + static_cast<std::ptrdiff_t>(num_of_head));
  path.plots.insert(path.plots.end(),
                    tail.members.begin() + static_cast<std::ptrdiff_t>(num_skipped),
                    tail.members.end());
  if (num_of_head == 0) return WithScore(std::move(path.plots));
  path.score = -std::numeric_limits<double>::infinity();
  const bool are_joined = num_skipped < tail.plots.size();
  if (are_joined && head.plots[num_of_head - 1]->frame == tail.plots[num_skipped]->frame) {
    return path;
  }
  for (std::size_t filter = 0; filter < head.hypotheses.size(); ++filter) {
    const TrackModel& model = models_[filter / config_.birth_speeds_mps.size()];
    const Hypothesis& from = head.hypotheses[filter][num_of_head - 1];
    path.score =
        std::max(path.score,
                 FilterFrom(model, from, tail.plots, tail.frame_times, num_skipped).back().score);
  }
  return path;
}

bool DropStretch(const std::function<TimeNs(std::uint32_t)>& time_of,
                 const std::function<Path(std::size_t, std::size_t)>& without, Droppable droppable,
                 Path* path) {
  constexpr TimeNs kPauseNs = 500'000'000;
  constexpr std::size_t kMaxPlots = 6;
  const Members& plots = path->plots;
  const std::size_t end = plots.size() - (droppable == Droppable::kRun ? 0 : 1);
  const auto begins_run = [&](std::size_t i) {
    return i == 0 || i == plots.size() || time_of(plots[i]) - time_of(plots[i - 1]) >= kPauseNs;
  };
  Path best = *path;
  for (std::size_t first = 0; first < plots.size(); ++first) {
    if (!begins_run(first)) continue;
    for (std::size_t last = first + 1; last <= std::min(end, first + kMaxPlots); ++last) {
      if (!begins_run(last) || last - first == plots.size()) continue;
      Path rest = without(first, last);
      if (rest.score > best.score) best = std::move(rest);
      if (droppable == Droppable::kRun) break;
    }
  }
  if (best.score <= path->score + kMinExchangeLog) return false;
  *path = std::move(best);
  return true;
}

bool DropStretch(const PathScorer& scorer, Droppable droppable, Path* path) {
  std::optional<PathScorer::Filtered> whole;  // most paths have no stretch to drop
  const auto without = [&](std::size_t first, std::size_t last) {
    if (!whole) whole = scorer.Filter(path->plots);
    return scorer.WithScore(*whole, first, *whole, last);
  };
  return DropStretch([&](std::uint32_t plot) { return scorer.plots()[plot].time_ns; }, without,
                     droppable, path);
}

bool IsOneTarget(const PathScorer& scorer, const Path& path, std::size_t num_before) {
  const auto middle = path.plots.begin() + static_cast<std::ptrdiff_t>(num_before);
  const Path before = scorer.WithScore(Members(path.plots.begin(), middle));
  const Path after = scorer.WithScore(Members(middle, path.plots.end()));
  return ValueOf(scorer.WithScore(path.plots)) > ValueOf(before) + ValueOf(after) + kMinExchangeLog;
}

bool CutAtPauses(const PathScorer& scorer, const OtherSideOfPause& other_side_of, Path* path) {
  const std::size_t num_plots = path->plots.size();
  for (std::size_t k = 1; k < path->plots.size(); ++k) {
    const auto time_ns = [&](std::size_t i) { return scorer.plots()[path->plots[i]].time_ns; };
    if (time_ns(k) - time_ns(k - 1) < kBodyPauseNs) continue;
    const auto middle = path->plots.begin() + static_cast<std::ptrdiff_t>(k);
    Members before(path->plots.begin(), middle);
    Members after(middle, path->plots.end());
    const OtherSide other = other_side_of(before, after);
    if (other == OtherSide::kNone || IsOneTarget(scorer, *path, k)) continue;
    path->plots = std::move(other == OtherSide::kBefore ? after : before);
    k = 0;  // what is left may have more
  }
  return path->plots.size() < num_plots;
}

bool IsInReach(const Plot& from, const Plot& to, double slack_m, const TrackerConfig& config) {
  const double dt_s = SecondsOf(to.time_ns - from.time_ns);
  return (to.position_m - from.position_m).norm() < config.max_speed_mps * dt_s + slack_m;
}

std::size_t ImprovePaths(const PathScorer& scorer, const TrackerConfig& config,
                         std::vector<Path>* paths) {
  const std::size_t count = paths->size();
  std::vector<Extent> extents;
  for (const Path& path : *paths) extents.push_back(ExtentOf(scorer.plots(), path));
  // Pairs are compared again only after one of them has changed.
  std::uint64_t now = 1;
  std::vector<std::uint64_t> changed(count, now);  // time of the last change,
  std::vector<std::uint64_t> compared(count, 0);   // of the last comparison with all later paths,
  std::vector<std::uint64_t> pruned(count, 0);     // and of the last pruning
  const auto note_change = [&](std::size_t i) {
    changed[i] = ++now;
    extents[i] = ExtentOf(scorer.plots(), (*paths)[i]);
  };
  std::size_t num_compared = 0;
  for (bool is_done = false; !is_done;) {
    const std::uint64_t before = now;
    for (std::size_t i = 0; i < count; ++i) {
      Path& a = (*paths)[i];
      const std::uint64_t last = std::exchange(compared[i], now);
      for (std::size_t j = i + 1; j < count && !a.plots.empty(); ++j) {
        Path& b = (*paths)[j];
        if (std::max(changed[i], changed[j]) <= last || b.plots.empty()) continue;
        if (!MayInteract(extents[i], extents[j], config)) continue;
        ++num_compared;
        if (!Exchange(scorer, config, &a, &b)) continue;
        note_change(i);
        note_change(j);
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      Path& path = (*paths)[i];
      if (changed[i] <= std::exchange(pruned[i], now) || path.plots.empty()) continue;
      if (DropStretch(scorer, Droppable::kRun, &path)) note_change(i);
    }
    is_done = now == before;
  }
  EraseIf(paths, IsTooShort);
  return num_compared;
}

}  // namespace unlidar
