// Finds the paths of flying targets among the plots of all frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/plots.hpp"
#include "tracking/scan_schedule.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Shorter paths are ignored: two plots fit any velocity.
constexpr int kMinPathPlots = 3;
// Gain in log likelihood required of a further target (by chance 6e-6), and of an exchange or a
// join of paths, so that they end.
constexpr double kInitiationLog = 12.0;
constexpr double kMinExchangeLog = 1.0;

// Track score that clutter alone reaches with a probability of at most `false_alarms`, if any of
// `num_plots` plots may be the first of a path: method.md (9).
double ScoreThreshold(double num_plots, double false_alarms, const TrackerConfig& config);

// Numbers of plots, ascending unless stated otherwise.
using Members = std::vector<std::uint32_t>;

struct Path {
  Members plots;
  // Track score: log likelihood ratio against clutter, relative to a uniform choice of the first
  // plot.
  double score = 0.0;
};

// Work done beyond the searches through all plots.
struct Effort {
  std::size_t pairs_compared = 0;  // of paths
  std::size_t plots_searched_again = 0;
};

// Returns paths by falling score through plots in order of frame time, with at most one plot per
// frame. Dynamic programming over frames: every plot keeps the best few hypotheses of how it was
// reached, each with its Kalman state (Singer's model). The best path is taken, then the next among
// the remaining plots. As this is greedy, pairs of paths then exchange tails, or join, while the
// sum of their scores grows, so that crossing targets get their own continuations. `effort`:
// output, may be null.
std::vector<Path> FindPaths(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                            const TrackerConfig& config, Effort* effort = nullptr);

// Same, searched with the median sigma_a alone, and once: changed paths are not searched again.
// Tells in a third of the time which plots belong to targets.
std::vector<Path> FindPathsRoughly(const std::vector<Plot>& plots,
                                   const ScanSchedule& scan_schedule, const TrackerConfig& config);

}  // namespace unlidar
