#include "unlidar/robust.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <set>

#include "unlidar/robust/floating.hpp"

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

// Evidence in so many frames: two plots of one frame are no two pieces of it.
bool HasFrames(const std::vector<Plot>& path, int least) {
  std::set<std::uint32_t> frames;
  for (const Plot& plot : path) frames.insert(plot.frame);
  return static_cast<int>(frames.size()) >= least;
}

// Whether a path is that of something that flies: people and cars are never off the ground. Their
// lower parts are not hit in every frame, so heights are the lowest of a while.
bool Flies(const std::vector<Plot>& path, const RobustConfig& config) {
  const auto window_ns = static_cast<TimeNs>(config.off_ground_window_s * 1e9);
  std::size_t num_high = 0;
  for (const Plot& plot : path) {
    double lowest_m = plot.lowest_m;
    for (const Plot& other : path) {
      if (std::abs(other.time_ns - plot.time_ns) <= window_ns) {
        lowest_m = std::min(lowest_m, other.lowest_m);
      }
    }
    if (lowest_m > config.off_ground_m) ++num_high;
  }
  return static_cast<double>(num_high) > config.off_ground_share * static_cast<double>(path.size());
}

// What a target returns for its range: returns per second times range^2, of the sensor that sees it
// best. In pauses it may be hidden: only frames near a plot in time count.
double EchoM2PerS(const Recording& recording, const std::vector<Plot>& path) {
  constexpr TimeNs kNearNs = 500'000'000;
  std::vector<double> returns(recording.sensors.size(), 0.0);
  std::vector<double> seconds_per_m2(recording.sensors.size(), 0.0);
  for (const Plot& plot : path) returns[plot.sensor] += static_cast<double>(plot.returns.size());
  auto next = path.begin();
  for (const FrameInfo& frame : recording.frames) {
    const TimeNs time_ns = (frame.begin_ns + frame.end_ns) / 2;
    while (next + 1 != path.end() &&
           std::abs((next + 1)->time_ns - time_ns) <= std::abs(next->time_ns - time_ns)) {
      ++next;
    }
    if (std::abs(next->time_ns - time_ns) > kNearNs) continue;
    seconds_per_m2[frame.sensor] += static_cast<double>(frame.end_ns - frame.begin_ns) *
                                    kSecondsPerNs / next->position_m.squaredNorm();
  }
  double echo = 0.0;
  for (std::size_t s = 0; s < returns.size(); ++s) {
    if (returns[s] > 0.0) echo = std::max(echo, returns[s] / seconds_per_m2[s]);
  }
  return echo;
}

}  // namespace

RobustResult FindTargetsRobust(const Recording& recording, const RobustConfig& config,
                               const TrajectoryConfig& trajectory_config) {
  RobustResult result;
  if (recording.points_m.empty()) return result;
  const Background background(recording, config.background);
  const PointsView structure_m(recording.points_m, background.structure());
  const Ground ground(structure_m, config.ground);
  const Support support(structure_m, ground, config.background.occluder_cell_deg, config.support);
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
  const Watch watch{static_cast<double>(ShortestPeriodNs(recording)) * kSecondsPerNs,
                    static_cast<int>(recording.sensors.size())};
  const auto is_target = [&](const Path& path) {
    if (path.score < threshold) return false;
    const std::vector<Plot> members = PlotsOf(path, plots);
    return HasFrames(members, config.min_plots) && Flies(members, config) &&
           EchoM2PerS(recording, members) > config.min_echo_m2_per_s;
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
