// A confirmed track of a stream: the few ways in which it may go on, and its rows.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "live/seen_plot.hpp"
#include "robust/collection/collect.hpp"
#include "robust/tracking/track_model.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

class TrackFollower {
 public:
  // Goes on from a flight. `models`: one for each agility, which outlive it.
  TrackFollower(int id, const Flight& flight, const std::vector<TrackModel>& models,
                const TrackerConfig& tracker, const CollectConfig& collect,
                const TrajectoryConfig& trajectory);

  int id() const { return id_; }

  // What each of the plots of a frame at `at` would bring it, beside being unseen.
  std::vector<double> GainsOf(const std::vector<SeenPlot>& plots, const Moment& at) const;

  // Goes on with one of these plots or none. `is_allowed` (plots).
  void Extend(const std::vector<SeenPlot>& plots, const std::vector<char>& is_allowed,
              const Moment& at);

  // Settles what was seen until `until_ns`, so that it cannot change any more, and gives the plots
  // of it that were not given yet.
  std::vector<SeenPlot> Settle(TimeNs until_ns);

  // The newest plot that is believed to be the target's.
  TimeNs last_evidence_ns() const;
  TimeNs first_evidence_ns() const { return first_evidence_ns_; }

  // Fits the trajectory to what was seen lately.
  void Fit();
  const Trajectory& trajectory() const { return *trajectory_; }
  const std::vector<Measurement>& measurements() const { return measurements_; }
  double depth_sigma_m() const { return collect_.facing_side_sigma * body_sigma_m_; }

  // Returns of the target in frames whose stamps lie in [from_ns, to_ns).
  int ReturnsBetween(TimeNs from_ns, TimeNs to_ns) const;

  // Whether it was near a place at that time.
  bool IsNear(const Eigen::Vector3d& place_m, double time_s) const;

  double score() const;

 private:
  struct Node {
    Hypothesis h;
    std::uint32_t model = 0;
    std::int32_t parent = kNone;
    std::size_t plot = 0;        // number among all that it ever took
    std::size_t segment = 0;     // of what lies between two long pauses
    double segment_score = 0.0;  // before it
    double now = 0.0;            // score, unseen since its plot
  };

  const SeenPlot& PlotOf(const Node& node) const { return plots_[node.plot - first_plot_]; }
  std::int32_t BestLeaf() const;
  // The newest node on the way to the best leaf that is believed, not only tried.
  std::int32_t Head() const;
  void Forget();
  Measurement Measure(const Node& node) const;

  int id_;
  const std::vector<TrackModel>* models_;
  TrackerConfig tracker_;
  CollectConfig collect_;
  TrajectoryConfig trajectory_config_;
  std::vector<Node> nodes_;           // parents before children
  std::vector<std::int32_t> leaves_;  // that may go on
  std::deque<SeenPlot> plots_;
  std::size_t first_plot_ = 0;  // number of the first in plots_
  std::int32_t settled_ = kNone;
  TimeNs first_evidence_ns_ = 0;
  std::optional<Trajectory> trajectory_;
  std::vector<Measurement> measurements_;
  std::vector<std::pair<TimeNs, int>> returns_;  // of these, by the stamps of their frames
  TimeNs scales_ns_ = 0;                         // when the scales were found
  double body_sum_m2_;                           // of the spread of returns across ray and motion
  double body_count_;
  double body_sigma_m_;
};

}  // namespace unlidar
