// Corrects the errors of the greedy search by comparing whole paths.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tracking/track_model.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {

// Scores given sequences of plots, with gaps of any length.
class PathScorer {
 public:
  PathScorer(const std::vector<Plot>& plots, const std::vector<double>& log_births,
             const ScanSchedule& scan_schedule, const TrackerConfig& config,
             TimeOutOfView time_out_of_view = TimeOutOfView::kNone)
      : plots_(plots),
        log_births_(log_births),
        scan_schedule_(scan_schedule),
        config_(config),
        time_out_of_view_(time_out_of_view) {}

  // Returns the path of these plots, with the score of the best sigma_a and birth speed; minus
  // infinity if two plots are of one frame.
  Path WithScore(std::vector<std::uint32_t> members) const;

  const std::vector<Plot>& plots() const { return plots_; }

 private:
  const std::vector<Plot>& plots_;
  const std::vector<double>& log_births_;
  ScanSchedule scan_schedule_;
  const TrackerConfig& config_;
  TimeOutOfView time_out_of_view_;
};

// Positions are noisy, and the initial velocity of a path is unknown.
constexpr double kReachSlack_m = 2.0;

// True if a target can fly from one plot to a later one within `max_speed_mps`, with position
// errors of `slack_m` in sum.
bool IsInReach(const Plot& from, const Plot& to, double slack_m, const TrackerConfig& config);

// Lets pairs of paths join or exchange tails, and single paths drop plots between two pauses, while
// the sum of scores grows. Removes paths that become too short. Returns the number of pairs
// compared: only those that a target could connect. method.md (8).
std::size_t ImprovePaths(const PathScorer& scorer, const TrackerConfig& config,
                         std::vector<Path>* paths);

}  // namespace unlidar
