// The best path through plots: dynamic programming over all of them in order of time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/queue.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// The plots of one frame.
struct Scan {
  struct Entry {
    Eigen::Vector3d position_m;
    double log_clutter;
    double score_threshold;  // of a hypothesis that may go on with it
    std::size_t plot;        // index into all plots
  };

  std::size_t first = 0;  // index of the first plot,
  std::size_t last = 0;   // and of the one after the last
  FrameTime at;
  FrameBounds bounds;
  std::vector<Entry> entries;  // by x
};

// Makes it that of the frame whose first plot is `first`, in the memory that it has.
void SetScan(const std::vector<Plot>& plots, const std::vector<double>& log_births,
             std::size_t first, const FrameTime& at, const TrackerConfig& config, Scan* scan);

// What all searches through the same plots, frame by frame in order of time, share. Size of
// `log_births`: that of `plots`.
std::vector<Scan> ScansOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                          const ScanSchedule& scan_schedule, const TrackerConfig& config);

// One of the alternatives that a search has found.
struct AlternativePath {
  struct Step {
    std::uint32_t plot = 0;
    double time_s = 0.0;  // in the middle of its frame,
    State state;          // and what was known then
  };
  std::vector<Step> steps;  // since it began
  double score = 0.0;       // unseen since the last of them
};

class TrackSearch {
 public:
  // Searches at once; `free` (size of `plots`) is kept: plots may cease to be free later on.
  // Best() and the like may be called then.
  TrackSearch(const std::vector<Plot>& plots, const std::vector<double>& log_births,
              const std::vector<Scan>& scans, const std::vector<char>& free,
              const TrackModel& model, const TrackerConfig& config);

  // For a stream, whose plots are still to come: Extend() carries the search on to each frame.
  TrackSearch(const std::vector<Plot>& plots, const std::vector<double>& log_births,
              const std::vector<char>& free, const TrackModel& model, const TrackerConfig& config);

  // The best path through plots that are still free; empty if none is worth anything.
  Path Best();

  // Carries all hypotheses on to the plots of a scan, later than all before.
  void Extend(const Scan& scan);

  // Appends the best path to each plot of the last scan, if its score is at min_score `min_score`.
  void AppendPathsToLastScan(double min_score, Queue<Path>* paths) const;

  // Begins nowhere else but with this one, as of a plot before all that follow.
  void Begin(const Hypothesis& hypothesis) { Add(hypothesis); }

  // Appends all alternatives, unseen from their last plots to the end, but for those whose score is
  // less than `min_score` then.
  void AppendAlternatives(const FrameTime& end, double min_score,
                          std::vector<AlternativePath>* alternatives) const;

  // Drops the hypotheses that hold plots which are free no more.
  void DropAssigned();

  // Forgets what leads nowhere, and the first plots, which the caller erases: what remains moves up
  // by so many.
  void Forget(std::size_t num_plots);

  void SetModel(const TrackModel& model) { model_ = model; }
  std::size_t num_hypotheses() const { return history_.size(); }

 private:
  struct Candidate {
    double score;
    ScoreIncrement increment;
    std::size_t index;  // of the prediction
  };

  // Of a path; the greatest is the best, of equal ones the first.
  struct PathEnd {
    double score;
    std::int32_t hypothesis;  // index into the history

    bool operator<(const PathEnd& other) const {
      return score < other.score || (score == other.score && hypothesis > other.hypothesis);
    }
  };

  void SetPathTo(std::int32_t hypothesis, Path* path) const;
  void Add(const Hypothesis& hypothesis);
  void Predict(const FrameTime& at);
  void PruneHypotheses(const Scan& scan);
  void FindCandidates(const Scan& scan);
  void InsertCandidate(const Candidate& candidate, std::vector<Candidate>* best) const;

  const std::vector<Plot>& plots_;
  const std::vector<double>& log_births_;
  const std::vector<char>& free_;
  TrackModel model_;
  const TrackerConfig& config_;
  std::vector<Hypothesis> history_;
  std::size_t last_scan_ = 0;            // where its hypotheses begin
  std::vector<PathEnd> ends_;            // heap of those that may still be free
  std::vector<std::int32_t> active_;     // those that may go on: indices into the history
  std::vector<Prediction> predictions_;  // of all active before, at the time at hand,
  std::vector<Motion> motions_;          // one for each time of a last plot,
  std::vector<ScoreBound> bounds_;       // how far they reach,
  std::vector<std::pair<double, std::size_t>> ranking_;  // minus promise, index of those kept
  std::vector<char> is_kept_;
  std::vector<std::int32_t> marks_;                 // (history) while some of it is dropped
  std::vector<Scan::Entry> entries_;                // of the free plots of the frame at hand
  std::vector<std::vector<Candidate>> candidates_;  // per plot of the frame at hand, the best first
};

}  // namespace unlidar
