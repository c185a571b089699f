#include "tracking/path_gates.hpp"

#include <utility>

#include "base/algorithms.hpp"
#include "tracking/flight.hpp"

namespace unlidar {

PathGates::PathGates(PathScorer scorer, double score_threshold, const Recording& recording,
                     const Queue<BodyBox>& bodies, const RobustConfig& config)
    : scorer_(std::move(scorer)),
      score_threshold_(score_threshold),
      recording_(recording),
      bodies_(bodies),
      config_(config) {}

Rejection PathGates::RejectionOf(const std::vector<std::uint32_t>& members) const {
  const auto reaches_threshold = [&](const std::vector<std::uint32_t>& numbers) {
    return ReachesThreshold(ValuesAt(numbers, members));
  };
  return FlightRejection(recording_, ValuesAt(members, scorer_.plots()), bodies_, reaches_threshold,
                         config_);
}

bool PathGates::IsNoDrone(const std::vector<std::uint32_t>& members) const {
  return TellsNoDrone(RejectionOf(members)) && ReachesThreshold(members);
}

bool PathGates::ReachesThreshold(std::vector<std::uint32_t> members) const {
  return scorer_.WithScore(std::move(members)).score >= score_threshold_;
}

}  // namespace unlidar
