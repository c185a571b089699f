#include "robust/robust.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

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
  for (std::size_t k = 0; k < paths.size(); ++k) {
    const Path& path = paths[k];
    if (!is_target(path)) continue;
    // A drone that shows as two plots in a frame leaves a second path beside its first.
    std::vector<Plot> members = PlotsOf(path, plots);
    members.erase(std::remove_if(members.begin(), members.end(),
                                 [&](const Plot& plot) { return HasAnyOf(plot, excluded); }),
                  members.end());
    if (2 * members.size() < path.plots.size() || !HasFrames(members, config.min_plots)) continue;
    AddStays(recording, taken, &members);
    for (const Plot& plot : members) {
      for (const std::uint32_t i : plot.returns) excluded[i] = 0;
    }
    Target target = CollectTarget(recording, sensor_views, members, excluded, config.collect,
                                  trajectory_config);
    // What another target's returns leave of it may be a single sighting, which is no track.
    if (target.measurements.size() < 2 || MayHang(target.measurements)) continue;
    if (IsClutter(target.measurements, threshold)) continue;
    target.score = path.score;
    target.doubts = DoubtsOf(k, paths, plots, watch, config.tracker, target.measurements);
    for (const std::uint32_t i : target.returns) excluded[i] = taken[i] = 1;
    result.targets.push_back(std::move(target));
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
