// Gates on a path beyond its score: detections, height, cross-section and crowding.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/clutter.hpp"
#include "scene/plots.hpp"
#include "scene/time_bins.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/rejection.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// True if the plots are of at least `min_frames` frames; two plots of one frame count once.
bool HasMinFrames(const std::vector<Plot>& path, int min_frames);

// True if nothing stands below a path: method.md (10). Objects that are there at other times as
// well, by the returns that the recording keeps, are no evidence of a body. `bodies`: in order of
// time.
bool HasNothingBelow(const Recording& recording, const std::vector<Plot>& path,
                     const Queue<BodyBox>& bodies, const RobustConfig& config);

// A target that moves farther is neither at rest nor suspended.
constexpr RangeRadius kMinDisplacement{0.8, 0.02};

// Returns the displacement between the means of the first and the last third of the plots.
Eigen::Vector3d DisplacementM(const std::vector<Plot>& path);

// True if the score of these plots of a path alone, by their numbers within it, reaches the
// threshold.
using ReachesThreshold = std::function<bool(const Members& numbers)>;

// Returns kNone for a path that has enough detections, is off the ground and has the cross-section
// of a drone. It is off the ground if its plots above the height of people and cars are enough for
// a path by themselves; where nothing stands below it, plots need only be clear of the ground.
// Those among them that no structure may carry must be enough, too (kOnStructure): people and
// vehicles pass over bridges and roofs. Seen from a carrier that travels meanwhile, it must also
// move over the ground: static objects come into range and leave it height by height, and so look
// like transient ones. Uses the sensors and frames of the recording, which may be only those about
// the path.
Rejection FlightRejection(const Recording& recording, const std::vector<Plot>& path,
                          const Queue<BodyBox>& bodies, const ReachesThreshold& reaches_threshold,
                          const RobustConfig& config);

// True if FlightRejection() knows that a path is no drone: few detections say nothing.
inline bool TellsNoDrone(Rejection rejection) {
  return rejection == Rejection::kNearGround || rejection == Rejection::kOnStructure ||
         rejection == Rejection::kStationary || rejection == Rejection::kWeakReturn;
}

// Applies FlightRejection() to plots that a scorer knows, in recordings and streams. A part of a
// path must reach the score threshold by itself.
class PathGates {
 public:
  // The plots of `scorer` and all else but the scorer must outlive it. `recording`, `bodies`: as in
  // FlightRejection().
  PathGates(PathScorer scorer, double score_threshold, const Recording& recording,
            const Queue<BodyBox>& bodies, const RobustConfig& config)
      : scorer_(std::move(scorer)),
        score_threshold_(score_threshold),
        recording_(recording),
        bodies_(bodies),
        config_(config) {}

  // Returns the rule that refuses these plots as a flight; kNone if none does.
  Rejection RejectionOf(const Members& members) const;

  // True if these plots are a path by themselves, but of no drone.
  bool IsNoDrone(const Members& members) const {
    return TellsNoDrone(RejectionOf(members)) && ReachesThreshold(members);
  }

 private:
  bool ReachesThreshold(Members members) const {
    return scorer_.WithScore(std::move(members)).score >= score_threshold_;
  }

  PathScorer scorer_;
  double score_threshold_;
  const Recording& recording_;
  const Queue<BodyBox>& bodies_;
  const RobustConfig& config_;
};

// Other plots count within this time of a plot: the clutter intensity is that of other times.
constexpr double kCrowdingReachS = (ClutterMap::kExclusionBins + 0.5) * kBinS;

// Returns the log-likelihood penalty for clutter that crowds about a path. The clutter intensity is
// the mean of other times, as of a Poisson process, but a bush in a gust, or a person behind a
// hedge, shows all at once: so the other plots around each plot at the same time count, and so do
// bursts at its very spot, where a twig that sways comes and goes. Given one plot of such clutter
// (its Palm distribution), those within kCrowdingReachS of it are expected, not the mean. Plots of
// targets, which are not free, and its own do not count.
// `num_frames_about`: number of frames of the sensor of a plot within kCrowdingReachS.
double CrowdingPenalty(const Members& path, const std::vector<Plot>& plots,
                       const std::vector<char>& are_free,
                       const std::function<std::uint32_t(const Plot&)>& num_frames_about);

}  // namespace unlidar
