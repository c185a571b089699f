// The path of plots that a flying target explains best: a search over all times at once.
#pragma once

#include <cstdint>
#include <vector>

#include "unlidar/robust/plots.hpp"

namespace unlidar {

struct TrackerConfig {
  std::vector<double> sigma_a_mps2 = {1.0, 3.0, 8.0};  // agility tried: hover, transit, sport
  double acceleration_time_s = 2.0;                    // how long an acceleration lasts
  double manoeuvre_factor = 3.0;  // between two plots it may be so much more agile,
  double manoeuvre_log = -2.3;    // with this log probability
  std::vector<double> birth_speeds_mps = {1.0, 8.0};  // standard deviations per axis tried
  double even_birth_share = 0.1;  // of the births; the others fall in proportion to volume
  double max_speed_mps = 35.0;
  double max_gap_s = 10.0;        // without a plot
  int hypotheses_per_plot = 2;    // kept at each plot and agility
  double echo_m2_per_s = 4000.0;  // expected returns per second of a typical drone, times range^2;
  double echo_shape = 1.5;        // shape of the gamma distribution about it
  double sensor_change = 0.1;     // probability that the next plot is that of another sensor
  // Carried on at any time, the best first: so many, and so many more for each plot of the frame.
  int max_hypotheses = 500;
  int max_hypotheses_per_plot = 5;
  int max_paths = 20;
  double min_fragment_log = 7.0;  // weaker paths are not looked at,
  int min_fragment_plots = 3;     // nor shorter ones
  double birth_cost = 12.0;       // what a further target must explain
  double min_exchange_log = 1.0;  // least gain of an exchange or a join
  double min_end_log = 3.0;       // what the plots at an end bring at least
  double give_up_log = -6.0;      // a hypothesis worse than this is dropped,
  double rebirth_log = -3.0;      // as is one so much worse than a new one at its last plot
};

// When each sensor watches the air.
struct Watch {
  struct Sensor {
    double frame_s = 0.1;                // how long a frame lasts
    std::vector<TimeNs> frame_times_ns;  // middles of its frames, ascending
  };
  std::vector<Sensor> sensors;

  std::uint32_t FramesBefore(std::uint32_t sensor, TimeNs time_ns) const;
};

Watch WatchOf(const Recording& recording);

struct Path {
  std::vector<std::uint32_t> plots;  // ascending
  // Log likelihood ratio against clutter, relative to that of an even choice of the first plot.
  double score = 0.0;
};

// Paths by falling score through plots that come frame by frame in order of time. Each has at most
// one plot of a frame. They are found by dynamic programming over frames, where every plot keeps
// the best few ways to reach it, each with its Kalman state (Singer's model); then the next in what
// is left. As this takes the best first, pairs of paths then exchange tails, or join, as long as
// the sum of their scores grows: crossing targets find their own continuation.
std::vector<Path> FindPaths(const std::vector<Plot>& plots, const Watch& watch,
                            const TrackerConfig& config);

}  // namespace unlidar
