// The gates of recordings and streams on the paths of a search.
#pragma once

#include <cstdint>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/rejection.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Applies FlightRejection() to plots that a scorer knows. A part of a path must reach the score
// threshold by itself.
class PathGates {
 public:
  // The plots of `scorer` and all else but the scorer must outlive it. `recording`, `bodies`: as in
  // FlightRejection().
  PathGates(PathScorer scorer, double score_threshold, const Recording& recording,
            const Queue<BodyBox>& bodies, const RobustConfig& config);

  // Returns the rule that refuses these plots as a flight; kNone if none does.
  Rejection RejectionOf(const std::vector<std::uint32_t>& members) const;

  // True if these plots are a path by themselves, but of no drone.
  bool IsNoDrone(const std::vector<std::uint32_t>& members) const;

 private:
  bool ReachesThreshold(std::vector<std::uint32_t> members) const;

  PathScorer scorer_;
  double score_threshold_;
  const Recording& recording_;
  const Queue<BodyBox>& bodies_;
  const RobustConfig& config_;
};

}  // namespace unlidar
