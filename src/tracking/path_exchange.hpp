// Corrects the errors of the greedy search by comparing whole paths.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "tracking/track_model.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {

// Filters a path: returns the hypothesis after each plot (plots), for the initial speed with the
// highest final score. `frame_times` (plots): of their frames.
std::vector<Hypothesis> FilterPath(const TrackModel& model, const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, double log_birth,
                                   const TrackerConfig& config);

// Scores given sequences of plots, with gaps of any length.
class PathScorer {
 public:
  using FrameTimeOfPlot = std::function<FrameTime(const Plot&)>;

  // `models`: one per sigma_a.
  PathScorer(const std::vector<Plot>& plots, const std::vector<double>& log_births,
             std::vector<TrackModel> models, FrameTimeOfPlot frame_time_of,
             const TrackerConfig& config)
      : plots_(plots),
        log_births_(log_births),
        models_(std::move(models)),
        frame_time_of_(std::move(frame_time_of)),
        config_(config) {}

  // For the plots of a recording.
  PathScorer(const std::vector<Plot>& plots, const std::vector<double>& log_births,
             const ScanSchedule& scan_schedule, const TrackerConfig& config,
             TimeOutOfView time_out_of_view = TimeOutOfView::kNone);

  // Returns the path of these plots, with the score of the best sigma_a and birth speed; minus
  // infinity if two plots are of one frame.
  Path WithScore(Members members) const;

  // A path with the states of its filters, one per sigma_a and birth speed, after each plot.
  struct Filtered {
    Members members;
    std::vector<const Plot*> plots;
    std::vector<FrameTime> frame_times;               // (plots)
    std::vector<std::vector<Hypothesis>> hypotheses;  // (filters, plots)
  };

  // Filters a path whose plots are of as many frames.
  Filtered Filter(const Members& members) const;

  // Same as WithScore() for the first `num_of_head` plots of one path, then those of another after
  // its first `num_skipped`, which are later. Filters the latter only.
  Path WithScore(const Filtered& head, std::size_t num_of_head, const Filtered& tail,
                 std::size_t num_skipped) const;

  const std::vector<Plot>& plots() const { return plots_; }

 private:
  const std::vector<Plot>& plots_;
  const std::vector<double>& log_births_;
  std::vector<TrackModel> models_;
  FrameTimeOfPlot frame_time_of_;
  const TrackerConfig& config_;
};

// Stretches of a path that DropStretch() may drop: at most six plots, between two pauses or before
// or after one.
enum class Droppable {
  // A single run of plots without a pause. Several runs are kept together in a recording: the
  // sparse beginning of a flight, before a long pause, may be true though it lowers the score.
  kRun,
  // Several runs, but not the last plot: in a stream the clutter of the first seconds is hardly
  // known, wrong rows cannot be taken back, and a path ends at the present frame.
  kRunsBeforeLast
};

// Drops the stretch of plots without which the score is highest, if it grows by more than
// kMinExchangeLog: a search with a limited gap had to use it, or it displaced the birth that later
// plots make likelier. `time_of`: of a plot of the path; `without`: the path without its plots
// [first, last). Returns true if the path changed.
bool DropStretch(const std::function<TimeNs(std::uint32_t)>& time_of,
                 const std::function<Path(std::size_t first, std::size_t last)>& without,
                 Droppable droppable, Path* path);

// Same, scored by `scorer`.
bool DropStretch(const PathScorer& scorer, Droppable droppable, Path* path);

// True if a path is likelier to be of one target than its first `num_before` plots and the others
// are of two, or either of none, as where paths join: method.md (8).
bool IsOneTarget(const PathScorer& scorer, const Path& path, std::size_t num_before);

// Across a pause of this length a path is within reach of people and cars.
constexpr TimeNs kBodyPauseNs = 1'000'000'000;

// The side of a pause that is not of the target of a path.
enum class OtherSide { kNone, kBefore, kAfter };

// Finds it between the plots before and after a pause, of those that are left of the path.
using OtherSideOfPause = std::function<OtherSide(const Members& before, const Members& after)>;

// Cuts off from a path, at pauses of kBodyPauseNs or more across which it is not one target, the
// side that is not of its target: a car or a walker that a drone passes. Returns true if the path
// changed, which then lacks its score.
bool CutAtPauses(const PathScorer& scorer, const OtherSideOfPause& other_side_of, Path* path);

// Positions are noisy, and the initial velocity of a path is unknown.
constexpr double kReachSlackM = 2.0;

// True if a target can fly from one plot to a later one within `max_speed_mps`, with position
// errors of `slack_m` in sum.
bool IsInReach(const Plot& from, const Plot& to, double slack_m, const TrackerConfig& config);

// Lets pairs of paths join or exchange tails, and single paths drop plots between two pauses, while
// the sum of scores grows. Removes paths that become too short. Returns the number of pairs
// compared: only those that a target could connect. method.md (8).
std::size_t ImprovePaths(const PathScorer& scorer, const TrackerConfig& config,
                         std::vector<Path>* paths);

}  // namespace unlidar
