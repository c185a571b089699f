// Best paths through plots by dynamic programming over frames.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "base/point_tree.hpp"
#include "base/queue.hpp"
#include "tracking/scan_schedule.hpp"
#include "tracking/track_model.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {

// A hypothesis is deleted where its track score falls below this, and not updated with a plot where
// it falls below the score of a birth there by this: re-initiation explains the plot better.
constexpr double kDeletionLog = -6.0;
constexpr double kReinitiationLog = -3.0;

// The plots of one frame, as a search takes them. Indices are those of all plots.
struct Scan {
  struct Entry {
    double log_clutter;
    double score_threshold;  // least score of a hypothesis that is updated with it
    std::size_t plot;
  };

  std::size_t first = 0;        // its first plot
  std::size_t last = 0;         // past its last plot
  const Plot* plots = nullptr;  // [first, last), of the caller
  FrameTime at;
  FrameBounds bounds;
  PointTree<double> positions_m;
  std::vector<Entry> entries;  // in the order of positions_m.points_m()

  const Plot& PlotAt(std::size_t plot) const { return plots[plot - first]; }
};

// Fills `scan` with the first frame of `plots`, reusing its memory. They are all plots from number
// `first` on; `log_births` has one value for each of all plots.
void SetScan(const Plot* plots, std::size_t num_plots, const std::vector<double>& log_births,
             std::size_t first, const FrameTime& at, Scan* scan);

// Scans for searches through `plots`, which are in order of frame time. `log_births`: one per plot.
// `begin_ns`: origin of time, by default that of the first plot.
std::vector<Scan> ScansOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                          const ScanSchedule& scan_schedule,
                          std::optional<TimeNs> begin_ns = std::nullopt);

// No plot is as low: paths may go on from the ground to anywhere.
inline constexpr double kNoGroundTargetsM = -std::numeric_limits<double>::infinity();

class TrackSearch {
 public:
  // Runs the search for paths above `min_score` >= 0. `free` (plots) is kept by reference: plots
  // may be taken later, before further calls of Best().
  TrackSearch(const std::vector<double>& log_births, const std::vector<Scan>& scans,
              const std::vector<char>& free, double min_score, const TrackModel& model,
              const TrackerConfig& config);

  // For a stream: Extend() adds each frame as it arrives. No path goes on from a plot of at most
  // `ground_target_m` height to a higher one where a new target is likelier: a refused path of a
  // car, which stays in the search, would be the likeliest way to any drone near it. `is_gated`:
  // nor to a plot beyond the gate or too far to be reached: such ways would displace those of
  // others.
  TrackSearch(const std::vector<double>& log_births, const std::vector<char>& free,
              const TrackModel& model, const TrackerConfig& config,
              double ground_target_m = kNoGroundTargetsM, bool is_gated = false);

  // Returns the best path through plots that are still free; empty, with score 0, if there is none.
  Path Best();

  // Extends all hypotheses to the plots of a scan, which must be later than all before.
  void Extend(const Scan& scan);

  // Appends the best path to each plot of the last scan, if its score is at least `min_score`.
  void AppendPathsToLastScan(double min_score, Queue<Path>* paths) const;

  // Raises `scores` (plots of the last scan, the first of which is `first`) to the score of the
  // best path of at least kMinPathPlots to each plot.
  void RaiseScores(std::size_t first, std::vector<double>* scores) const;

  // Returns the highest gain of a plot of a later frame at `at` over a missed detection, of the
  // hypotheses that satisfy `is_one(hypothesis)`; 0 if none is positive.
  template <class IsOne>
  double GainOf(const Plot& plot, const FrameTime& at, const IsOne& is_one) const {
    double gain = 0.0;
    for (const Hypothesis& from : active_) {
      if (is_one(from)) {
        gain = std::max(gain, model_.GainOf(from, plot, at));
      }
    }
    return gain;
  }

  // Starts from this hypothesis, whose plot must be earlier than all that follow.
  void Begin(const Hypothesis& hypothesis) {
    last_scan_ = history_.size();
    Add(hypothesis);
  }

  // Appends the hypotheses added by the last Begin() or Extend(), in order of their nodes.
  void AppendLatest(std::vector<Hypothesis>* hypotheses) const;

  // Drops the hypotheses with plots that are no longer free.
  void DropAssigned();

  // Removes the first `num_plots` plots, which the caller erases, and all hypotheses that neither
  // an active one nor the end of a path descends from: most births are never continued. No path may
  // end at one of these plots. Indices of plots shift by `num_plots`.
  void Forget(std::size_t num_plots);

  void SetModel(const TrackModel& model) {
    model_ = model;
    for (Hypothesis& h : active_) h.other_sensor = kNoSensor;  // it was that of the old model
  }
  std::size_t num_hypotheses() const { return history_.size(); }

 private:
  // Part of a hypothesis that its paths need after its last continuation. Only hypotheses that can
  // be extended keep their state, to save memory: a recording has many, and most lead nowhere.
  struct Node {
    double score;
    std::int32_t plot;
    std::int32_t parent;  // index into the history
    std::uint32_t num_plots;
  };

  // What an active hypothesis may score in the current frame. Most reach none of its plots, so that
  // no more of their predictions is needed.
  struct Outlook {
    double score;  // including missed detections up to the frame
    double top;    // TopOf()
    AxisVariances steady;
    std::uint32_t hypothesis;  // index of the active hypothesis
    std::uint32_t motion;      // index of the motion since its last plot
  };

  struct Candidate {
    double score;
    ScoreIncrement increment;
    std::uint32_t hypothesis;
    std::size_t index;  // of the prediction
  };

  // End of a path; the greatest is the best, among equal ones the first.
  struct PathEnd {
    double score;
    std::int32_t hypothesis;  // index into the history

    bool operator<(const PathEnd& other) const {
      return score < other.score || (score == other.score && hypothesis > other.hypothesis);
    }
  };

  const Node& NodeAt(std::int32_t index) const { return history_[static_cast<std::size_t>(index)]; }
  std::int32_t& MarkOf(std::int32_t node) { return marks_[static_cast<std::size_t>(node)]; }
  void MarkAncestors(std::int32_t node, std::int32_t first_plot);
  void AppendEnds(double min_score);
  void SetPathTo(std::int32_t hypothesis, Path* path) const;
  void Add(Hypothesis hypothesis);
  void LookAhead(const Scan& scan);
  void PruneHypotheses(const Scan& scan);
  void FindCandidates(const Scan& scan);
  bool SetLeastBound(const Scan& scan, std::uint32_t id);
  void Continue(const Outlook& outlook, const Scan& scan);
  bool ContinueToLeaf(const Scan& scan, const PointTree<double>::Node& leaf,
                      const ScoreBound& bound);
  void InsertCandidate(const Candidate& candidate, std::vector<Candidate>* best) const;

  const std::vector<double>& log_births_;
  const std::vector<char>& free_;
  TrackModel model_;
  const TrackerConfig& config_;
  double ground_target_m_;
  bool is_gated_;
  std::vector<Node> history_;            // all hypotheses
  std::size_t last_scan_ = 0;            // index of its first hypothesis in the history
  std::vector<PathEnd> ends_;            // heap; their plots may have been taken since
  std::vector<Hypothesis> active_;       // to extend, in order of their nodes
  std::vector<Motion> motions_;          // one per time of a last plot
  std::vector<Outlook> outlooks_;        // of the active hypotheses, at the current frame
  std::vector<Prediction> predictions_;  // of those that reach a leaf of the tree of its plots
  std::vector<std::pair<double, std::size_t>> ranking_;  // (-top, outlook)
  std::vector<char> is_kept_;
  std::vector<std::int32_t> marks_;  // (history) scratch: kKept or the new index, or kNoIndex
  // Least score with which a plot of the current frame is taken, by entry, and least bound of a
  // score before its clutter, by node of the tree of the frame.
  std::vector<double> thresholds_;
  std::vector<double> least_bounds_;
  std::vector<std::vector<Candidate>> candidates_;  // per plot of the current frame, best first
};

}  // namespace unlidar
