// What a search that takes the best path first gets wrong, put right by comparing whole paths.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tracking/tracker.hpp"

namespace unlidar {

// Scores given sequences of plots, which may hold gaps of any length.
class PathScorer {
 public:
  PathScorer(const std::vector<Plot>& plots, const std::vector<double>& log_births,
             const ScanSchedule& scan_schedule, const TrackerConfig& config)
      : plots_(plots), log_births_(log_births), scan_schedule_(scan_schedule), config_(config) {}

  // The path of these plots, with the score of the agility and birth speed that suit it best; minus
  // infinity where two of them are of one frame.
  Path WithScore(std::vector<std::uint32_t> members) const;

  const std::vector<Plot>& plots() const { return plots_; }

 private:
  const std::vector<Plot>& plots_;
  const std::vector<double>& log_births_;
  ScanSchedule scan_schedule_;
  const TrackerConfig& config_;
};

// Whether a target can get from one plot to a later one, if their positions together are off by
// `slack_m` at most.
bool IsInReach(const Plot& from, const Plot& to, double slack_m, const TrackerConfig& config);

// Lets pairs of paths join or exchange what follows some time, and single paths drop what stands
// between two pauses, as long as the sum of scores grows. Paths that become too short are removed.
// Returns how many pairs were compared: only those that a target could connect.
std::size_t ImprovePaths(const PathScorer& scorer, const TrackerConfig& config,
                         std::vector<Path>* paths);

}  // namespace unlidar
