#include "robust/robust.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>

#include "robust/plots/floating.hpp"
#include "robust/scene/field_of_view.hpp"
#include "robust/tracking/flight.hpp"

namespace unlidar {
namespace {

std::vector<Plot> PlotsOf(const Path& path, const std::vector<Plot>& plots) {
  std::vector<Plot> members;
  for (const std::uint32_t i : path.plots) members.push_back(plots[i]);
  return members;
}

bool IsTaken(const Plot& plot, const std::vector<char>& excluded) {
  return std::any_of(plot.returns.begin(), plot.returns.end(),
                     [&](std::uint32_t i) { return excluded[i] != 0; });
}

}  // namespace

RobustResult FindTargetsRobust(const Recording& recording, const RobustConfig& config,
                               const TrajectoryConfig& trajectory_config) {
  RobustResult result;
  if (recording.points_m.empty()) return result;
  const Background background(recording, config.background);
  const PointsView structure_m(recording.points_m, background.structure());
  const Ground ground(structure_m, config.ground);
  FieldOfView view;
  for (const Eigen::Vector3f& point_m : recording.points_m) view.Add(point_m);
  const Support support(structure_m, ground, view.Edges(), config.background.occluder_cell_deg,
                        config.support);
  // What stands still in the air all the time looks like structure, but is none.
  const std::vector<std::uint32_t> floating =
      support.FloatingReturns(recording, background.structure());
  std::vector<std::uint32_t> candidates;
  std::merge(background.unexplained().begin(), background.unexplained().end(), floating.begin(),
             floating.end(), std::back_inserter(candidates));
  // Ground far away is hit too seldom to be known by its occupancy.
  candidates.erase(
      std::remove_if(candidates.begin(), candidates.end(),
                     [&](std::uint32_t i) { return ground.Holds(recording.points_m[i]); }),
      candidates.end());
  std::vector<char> excluded;  // returns of bodies, then also of targets found
  std::vector<Plot> plots = MakePlots(recording, candidates, ground, config.plots, &excluded);
  MarkFloating(recording, support, config.background.place, &plots);
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
    return IsFlight(recording, members, config);
  };

  // What the first round finds is clutter no more for the second, which then sees farther. What
  // floats in one place is none from the start.
  std::vector<char> explained(plots.size(), 0);
  std::vector<char> is_standing(recording.points_m.size(), 0);
  for (const std::uint32_t i : floating) is_standing[i] = 1;
  for (std::size_t i = 0; i < plots.size(); ++i) {
    explained[i] = plots[i].is_floating && IsTaken(plots[i], is_standing);
  }
  std::vector<Path> paths;
  for (int round = 0; round < config.rounds; ++round) {
    EstimateClutter(background, config.plots, explained, &plots);
    paths = FindPaths(plots, watch, config.tracker);
    const std::vector<char> before = explained;
    for (const Path& path : paths) {
      if (!is_target(path)) continue;
      for (const std::uint32_t i : path.plots) explained[i] = 1;
    }
    if (explained == before) break;
  }

  result.counts = {candidates.size(),
                   static_cast<std::size_t>(std::count(excluded.begin(), excluded.end(), 1)),
                   plots.size(), paths.size(), threshold};
  for (const Path& path : paths) {
    if (!is_target(path)) continue;
    // A drone that shows as two plots in a frame leaves a second path beside its first.
    std::vector<Plot> members = PlotsOf(path, plots);
    members.erase(std::remove_if(members.begin(), members.end(),
                                 [&](const Plot& plot) { return IsTaken(plot, excluded); }),
                  members.end());
    if (2 * members.size() < path.plots.size() || !HasFrames(members, config.min_plots)) continue;
    Target target =
        CollectTarget(recording, background, members, excluded, config.collect, trajectory_config);
    if (target.measurements.empty()) continue;
    target.score = path.score;
    for (const std::uint32_t i : target.returns) excluded[i] = 1;
    result.targets.push_back(std::move(target));
  }
  return result;
}

}  // namespace unlidar
