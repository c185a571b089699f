#include "robust/robust.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "robust/collection/cloud.hpp"
#include "robust/collection/hanging.hpp"
#include "robust/collection/stays.hpp"
#include "robust/plots/views.hpp"
#include "robust/tracking/doubts.hpp"
#include "robust/tracking/flight.hpp"

namespace unlidar {
namespace {

std::vector<Plot> PlotsOf(const Path& path, const std::vector<Plot>& plots) {
  std::vector<Plot> members;
  for (const std::uint32_t i : path.plots) members.push_back(plots[i]);
  return members;
}

// Whether what was collected of a target is less likely it, by what its places return at other
// times, than any path must be. A place where it always was tells neither.
bool IsClutter(const std::vector<Measurement>& measurements, double threshold) {
  double log_ratio = 0.0;
  for (const Measurement& m : measurements) {
    if (m.log_ratio == 0.0) return false;
    log_ratio += m.log_ratio;
  }
  return log_ratio < threshold;
}

// The target that has most of the plots of a path; their number if none has.
std::size_t OwnerOf(const Path& path, const std::vector<Plot>& plots,
                    const std::vector<Target>& targets) {
  const auto is_owner = [&](const Target& target) {
    const auto has = [&](std::uint32_t p) {
      const std::vector<std::uint32_t>& returns = plots[p].returns;
      return std::any_of(returns.begin(), returns.end(), [&](std::uint32_t i) {
        return std::binary_search(target.returns.begin(), target.returns.end(), i);
      });
    };
    const auto own = std::count_if(path.plots.begin(), path.plots.end(), has);
    return 2 * static_cast<std::size_t>(own) > path.plots.size();
  };
  return static_cast<std::size_t>(std::find_if(targets.begin(), targets.end(), is_owner) -
                                  targets.begin());
}

// Adds to the path of a target what another one has before or after it, with its share of the
// score, and tells whether that is at least so many frames.
bool GoesOnBeyond(const Target& target, const std::vector<Plot>& plots, int least_frames,
                  const std::vector<char>& excluded, const Path& other, Path* path) {
  const TimeNs begin_ns = target.measurements.front().time_ns;
  const TimeNs end_ns = target.measurements.back().time_ns;
  Path beyond;
  for (const std::uint32_t p : other.plots) {
    const bool is_within = begin_ns <= plots[p].time_ns && plots[p].time_ns <= end_ns;
    if (!is_within && !HasAnyOf(plots[p], excluded)) beyond.plots.push_back(p);
  }
  if (!HasFrames(PlotsOf(beyond, plots), least_frames)) return false;
  path->score += other.score * static_cast<double>(beyond.plots.size()) /
                 static_cast<double>(other.plots.size());
  path->plots.insert(path->plots.end(), beyond.plots.begin(), beyond.plots.end());
  std::sort(path->plots.begin(), path->plots.end());
  return true;
}

}  // namespace

RobustResult FindTargetsRobust(const Recording& recording, const RobustConfig& config,
                               const TrajectoryConfig& trajectory_config) {
  RobustResult result;
  if (recording.points_m.empty()) return result;
  Views views(recording, Stations(recording.sensors), config);
  const std::vector<Plot>& plots = views.plots();
  // A score is a log likelihood ratio, weighted by how likely its first plot is the first: so by
  // Ville's inequality clutter reaches the threshold from all plots and with all models together
  // with a probability of at most false_alarms_per_recording.
  const std::size_t num_models =
      config.tracker.sigma_a_mps2.size() * config.tracker.birth_speeds_mps.size();
  const auto num_starts = static_cast<double>(std::max<std::size_t>(plots.size(), 1) * num_models);
  const double threshold = std::log(num_starts / config.false_alarms_per_recording);
  const Watch watch = WatchOf(recording);
  const auto is_target = [&](const Path& path) {
    if (path.score < threshold) return false;
    const std::vector<Plot> members = PlotsOf(path, plots);
    return IsFlight(recording, watch, members, config);
  };

  // What the first round finds is clutter no more for the second, which then sees farther. What
  // floats in one place is none from the start.
  std::vector<char> explained = views.are_parked();
  std::vector<Path> paths;
  for (int round = 0; round < config.rounds; ++round) {
    views.EstimateClutter(explained);
    paths = FindPaths(plots, watch, config.tracker);
    const std::vector<char> before = explained;
    for (const Path& path : paths) {
      if (!is_target(path)) continue;
      for (const std::uint32_t i : path.plots) explained[i] = 1;
    }
    if (explained == before) break;
  }

  std::vector<char> excluded = views.are_bodies();  // and then also the returns of targets found
  std::vector<char> taken(excluded.size(), 0);      // these alone
  const std::vector<SensorView> sensor_views = views.SensorViews();
  result.counts = {views.num_unexplained(),
                   static_cast<std::size_t>(std::count(excluded.begin(), excluded.end(), 1)),
                   plots.size(), paths.size(), threshold};
  std::vector<std::size_t> path_of;  // (targets)
  const auto collect = [&](std::size_t k, std::vector<Plot> members) -> std::optional<Target> {
    AddStays(recording, taken, &members);
    for (const Plot& plot : members) {
      for (const std::uint32_t i : plot.returns) excluded[i] = 0;
    }
    Target target = CollectTarget(recording, sensor_views, members, excluded, config.collect,
                                  trajectory_config);
    // What another target's returns leave of it may be a single sighting, which is no track.
    if (target.measurements.size() < 2 || MayHang(target.measurements)) return std::nullopt;
    if (IsClutter(target.measurements, threshold)) return std::nullopt;
    target.score = paths[k].score;
    target.doubts = DoubtsOf(k, paths, plots, watch, config.tracker, target.measurements);
    return target;
  };
  const auto take = [&](const Target& target, char is_taken) {
    for (const std::uint32_t i : target.returns) excluded[i] = taken[i] = is_taken;
  };
  for (std::size_t k = 0; k < paths.size(); ++k) {
    if (!is_target(paths[k])) continue;
    std::vector<Plot> members = PlotsOf(paths[k], plots);
    members.erase(std::remove_if(members.begin(), members.end(),
                                 [&](const Plot& plot) { return HasAnyOf(plot, excluded); }),
                  members.end());
    if (2 * members.size() >= paths[k].plots.size()) {
      if (!HasFrames(members, config.min_plots)) continue;
      if (std::optional<Target> target = collect(k, std::move(members))) {
        take(*target, 1);
        result.targets.push_back(std::move(*target));
        path_of.push_back(k);
      }
      continue;
    }
    // A drone that shows as two plots in a frame leaves a second path beside its first, which may
    // go on where the first ends.
    const std::size_t t = OwnerOf(paths[k], plots, result.targets);
    if (t == result.targets.size()) continue;
    Target& owner = result.targets[t];
    const Path before = paths[path_of[t]];
    Path& joined = paths[path_of[t]];
    if (!GoesOnBeyond(owner, plots, config.min_plots, excluded, paths[k], &joined)) continue;
    take(owner, 0);
    if (std::optional<Target> target = collect(path_of[t], PlotsOf(joined, plots))) {
      owner = std::move(*target);
    } else {
      joined = before;
    }
    take(owner, 1);
  }
  result.targets =
      WithoutClouds(recording, sensor_views, plots, std::move(result.targets), trajectory_config);
  for (Target& target : result.targets) {
    for (Measurement& m : target.measurements) m.time_ns += target.late_ns;
    for (Doubt& doubt : target.doubts) doubt.time_ns += target.late_ns;
  }
  return result;
}

}  // namespace unlidar
