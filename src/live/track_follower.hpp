// A track of a stream: its few best association hypotheses, and its fit.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "collection/body.hpp"
#include "collection/frame_timing.hpp"
#include "live/live_plot.hpp"
#include "live/recent_frame_times.hpp"
#include "live/track_fit.hpp"
#include "tracking/track_model.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/trajectory_fitter.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// A plot that may belong to a track.
struct FollowedPlot {
  LivePlot seen;
  FrameTime at;  // of its frame
};

// Returns the path of a reacquired target across the gap before it, from its last confirmed plot to
// the last of `plots`: the numbers of its plots in `plots`, and the hypothesis after each. As in a
// recording, the target may have been out of view, and short stretches of plots that lower the
// score are left out: the follower had to use some plot at least every max_gap_s, whether or not it
// was of the target.
std::vector<std::pair<std::size_t, Hypothesis>> RejoinedPlots(
    const TrackModel& model, const Hypothesis& confirmed, const std::vector<FollowedPlot>& plots);

// Follows a flight back in time, as a track is followed forward. Plots that the search left out,
// because they scored no better than clutter then, join it where they match the prediction.
// `seen`: plots in order of time, including those of the flight; `are_free` (seen): true if no
// track has the plot; `frame_times`: of their frames; `num_frames` (sensors): up to now. Returns
// the indices of plots before the flight, in order of time.
std::vector<std::uint32_t> ExtendBackwards(const Flight& flight, const RecentPlots& seen,
                                           const std::vector<char>& are_free,
                                           const RecentFrameTimes& frame_times,
                                           const std::vector<std::uint32_t>& num_frames,
                                           const std::vector<TrackModel>& models,
                                           const RobustConfig& config);

// Association hypotheses that a track carries from frame to frame: most plots have one for each
// agility.
constexpr std::size_t kMaxHypotheses = 48;

class TrackFollower {
 public:
  // Continues a flight. `models`: one for each agility. They and `config` must outlive the
  // follower.
  TrackFollower(const Flight& flight, const std::vector<TrackModel>& models,
                const RobustConfig& config, std::size_t max_hypotheses = kMaxHypotheses);

  // Sets `gains` (plots): track score of the best hypothesis with each plot of a frame at `at`,
  // less its score with a missed detection.
  void SetGains(const std::vector<LivePlot>& plots, const FrameTime& at,
                std::vector<double>* gains) const;

  // Extends the hypotheses by one of these plots or a missed detection. `is_allowed` (plots).
  void Extend(const std::vector<LivePlot>& plots, const std::vector<char>& is_allowed,
              const FrameTime& at);

  // Makes the associations until `until_ns` final, and appends the plots that this settles.
  void Settle(TimeNs until_ns, std::vector<LivePlot>* settled);

  // Returns the plots of the path with the highest score, the last one first, before any are
  // settled. A target that may be gone after any plot is not charged for missed detections behind
  // its last one.
  std::vector<LivePlot> LikeliestPath() const;

  // Time of the newest confirmed plot.
  TimeNs last_evidence_ns() const { return PlotOf(NodeAt(NewestConfirmed())).plot.time_ns; }
  // Time of the newest plot that may belong to the target.
  TimeNs last_tentative_ns() const;
  TimeNs first_evidence_ns() const { return first_evidence_ns_; }

  void Fit(TrajectoryFitter& fitter);
  const TrackFit& fit() const { return fit_; }
  // True if plots were added since the last fit.
  bool has_new_plots() const { return has_new_plots_; }

  // Time of the returns less their stamped time, same as Target::time_bias_ns.
  TimeNs time_bias_ns() const { return time_bias_ns_; }

  // Same as those of Target.
  CommonErrors common_errors() const {
    return {facing_.sigma * body_sigma_m_, elevation_sigma_m_, time_sigma_s_};
  }

  // Returns where the target was at a time, or is predicted to be.
  Eigen::Vector3d PlaceAtM(double time_s) const;

  // True if the target has not been seen for so long that it must be reacquired.
  bool IsLost(double time_s) const;

  double score() const { return NodeAt(BestLeaf()).h.score; }

 private:
  struct Node {
    Hypothesis h;
    std::uint32_t model = 0;
    std::int32_t parent = kNoIndex;
    std::size_t plot = 0;               // index into plots_
    std::int32_t confirmed = kNoIndex;  // newest confirmed node on its path, or itself
    double current_score = 0.0;         // track score with the missed detections since its plot
  };

  // The best predecessor of a plot, for a model.
  struct Association {
    double score = -1e300;
    std::size_t predicted = 0;  // index of its prediction
    ScoreIncrement gain;

    bool exists() const { return score > -1e300; }
  };

  struct PredictedLeaf {
    std::int32_t leaf = kNoIndex;
    Motion motion;
    Prediction prediction;
  };

  // Buffers, reused from frame to frame.
  struct Scratch {
    std::vector<Association> associations;                 // (plots, models)
    std::vector<PredictedLeaf> predicted;                  // leaves that may be the best of a plot
    std::vector<std::pair<double, std::int32_t>> ranking;  // of the next leaves: (-score, leaf)
    std::vector<std::int32_t> moved;                       // (nodes) new indices
    std::vector<std::size_t> moved_plots;                  // (plots) likewise
  };

  Node& NodeAt(std::int32_t index) { return nodes_[static_cast<std::size_t>(index)]; }
  const Node& NodeAt(std::int32_t index) const { return nodes_[static_cast<std::size_t>(index)]; }
  const LivePlot& PlotOf(const Node& node) const { return plots_[node.plot]; }
  void AddPlot(const LivePlot& seen, const FrameTime& at);
  void Associate(const std::vector<LivePlot>& plots, const std::vector<char>& is_allowed,
                 const FrameTime& at);
  void AllowAgilityChanges();
  void Rejoin(std::int32_t confirmed, Node* node);
  std::int32_t BestLeaf() const;
  std::int32_t LikeliestEnd() const;  // of all paths
  // The newest confirmed node on the path to a leaf, and on the path to the best leaf. Settled
  // nodes are confirmed.
  std::int32_t ConfirmedAt(std::int32_t leaf) const {
    return std::max(settled_, NodeAt(leaf).confirmed);
  }
  std::int32_t NewestConfirmed() const { return ConfirmedAt(BestLeaf()); }
  void Forget();
  void MarkAncestors(std::int32_t leaf, double from_s);

  // Timing of a sensor, from this many returns of the target.
  struct SensorTiming {
    int num_returns = 0;
    FrameTiming frames;
  };
  void AddToBody(const LivePlot& seen, const Eigen::Vector3d& velocity_mps);
  void AddToTimings(const Node& node, std::vector<SensorTiming>* timings) const;
  void UpdateTiming();

  const std::vector<TrackModel>* models_;
  const RobustConfig* config_;
  std::size_t max_hypotheses_;
  std::vector<Node> nodes_;           // parents first
  std::vector<std::int32_t> leaves_;  // that can be extended
  std::size_t num_kept_nodes_ = 0;    // when the others were last forgotten
  std::vector<LivePlot> plots_;       // of the nodes, in order of frames
  RecentFrameTimes frame_times_;      // of these plots
  TimeNs first_evidence_ns_ = 0;
  double first_time_s_;  // of its frame
  TrackFit fit_;
  double body_sigma_m_;
  double body_scatter_m2_;  // horizontally across the ray
  double body_count_;
  FacingSide facing_side_;
  FacingShare facing_;
  std::vector<SensorTiming> settled_timings_;  // (sensors) from settled plots,
  std::vector<SensorTiming> timings_;          // and from all confirmed ones
  TimeNs time_bias_ns_ = 0;
  double elevation_sigma_m_ = 0.0;
  double time_sigma_s_ = 0.0;
  Scratch scratch_;
  std::int32_t settled_ = kNoIndex;  // the newest settled node
  bool has_new_plots_ = true;
};

}  // namespace unlidar
