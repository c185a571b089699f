// A confirmed track of a stream: the few associations in which it may go on, and its rows.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/queue.hpp"
#include "collection/collect.hpp"
#include "collection/frame_length.hpp"
#include "live/live_plot.hpp"
#include "live/track_fit.hpp"
#include "tracking/track_model.hpp"
#include "trajectory/trajectory_fitter.hpp"

namespace unlidar {

class TrackFollower {
 public:
  // Goes on from a flight. `models`: one for each agility, which outlive it.
  TrackFollower(const Flight& flight, const std::vector<TrackModel>& models,
                const TrackerConfig& tracker, const CollectConfig& collect);

  // Sets what each of the plots of a frame at `at` would bring it, beside being unseen.
  void SetGains(const std::vector<LivePlot>& plots, const FrameTime& at,
                std::vector<double>* gains) const;

  // Goes on with one of these plots or none. `is_allowed` (plots).
  void Extend(const std::vector<LivePlot>& plots, const std::vector<char>& is_allowed,
              const FrameTime& at);

  // Settles what was seen until `until_ns`, so that it cannot change any more, and appends the
  // plots of it that were not given yet.
  void Settle(TimeNs until_ns, std::vector<LivePlot>* settled);

  // The newest plot that is confirmed to be the target's.
  TimeNs last_evidence_ns() const;
  // The newest plot that may be the target's.
  TimeNs last_tentative_ns() const;
  TimeNs first_evidence_ns() const { return first_evidence_ns_; }

  // Fits the trajectory to what was seen lately.
  void Fit(TrajectoryFitter& fitter);
  const TrackFit& fit() const { return fit_; }

  // So much later than their times say returns were measured, as Target::time_bias_ns.
  TimeNs time_bias_ns() const { return time_bias_ns_; }

  double depth_sigma_m() const { return kFacingSideSigma * body_sigma_m_; }

  // Whether it was near a place at that time.
  bool IsNear(const Eigen::Vector3d& place_m, double time_s) const;

  double score() const;

 private:
  struct Node {
    Hypothesis h;
    std::uint32_t model = 0;
    std::int32_t parent = kNoIndex;
    std::size_t plot = 0;               // number among all that it ever took
    std::int32_t confirmed = kNoIndex;  // newest node on its way that is not only tried, or itself
    double current_score = 0.0;         // score, unseen since its plot
  };

  // The best way to a plot, for a model.
  struct Association {
    double score = -1e300;
    std::int32_t leaf = kNoIndex;
    ScoreIncrement gain;
  };

  // What one frame is worked on with, kept for the next.
  struct Scratch {
    std::vector<Association> associations;                   // (plots, models)
    std::vector<std::pair<Motion, Prediction>> predictions;  // (leaves)
    std::vector<std::int32_t> leaves;
    std::vector<std::int32_t> moved;  // (nodes) where they go
  };

  const LivePlot& PlotOf(const Node& node) const { return plots_[node.plot - first_plot_]; }
  std::int32_t BestLeaf() const;
  // The newest confirmed node on the way to a leaf, and to the best one.
  std::int32_t ConfirmedAt(std::int32_t leaf) const;
  std::int32_t NewestConfirmed() const;
  void Forget();
  Measurement Measure(const Node& node) const;

  // What is known of how long the frames of a sensor last, by how many returns of the target.
  struct FrameLengthEstimate {
    int num_returns = 0;
    FrameLength length;
  };
  void UpdateFrameLength(const Node& node, std::vector<FrameLengthEstimate>* lengths) const;
  void UpdateTimeBias();

  const std::vector<TrackModel>* models_;
  TrackerConfig tracker_;
  CollectConfig collect_;
  std::vector<Node> nodes_;           // parents before children
  std::vector<std::int32_t> leaves_;  // that may go on
  Queue<LivePlot> plots_;
  std::size_t first_plot_ = 0;  // number of the first in plots_
  std::int32_t settled_ = kNoIndex;
  TimeNs first_evidence_ns_ = 0;
  TrackFit fit_;
  double body_scatter_m2_;  // of the spread of returns across ray and motion
  double body_count_;
  double body_sigma_m_;
  std::vector<FrameLengthEstimate> settled_lengths_;  // (sensors) by what is settled,
  std::vector<FrameLengthEstimate> lengths_;          // and by all that is confirmed
  TimeNs time_bias_ns_ = 0;
  Scratch scratch_;
};

}  // namespace unlidar
