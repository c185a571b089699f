// Gates on a path beyond its score: detections, height and return rate.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/plots.hpp"
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
using ReachesThreshold = std::function<bool(const std::vector<std::uint32_t>& numbers)>;

// Returns kNone for a path that has enough detections, is off the ground and has the return rate of
// a drone. It is off the ground if its plots above the height of people and cars are enough for a
// path by themselves; where nothing stands below it, plots need only be clear of the ground. Those
// among them that no structure may carry must be enough, too (kOnStructure): people and vehicles
// pass over bridges and roofs. Seen from a carrier that travels meanwhile, it must also move over
// the ground: static objects come into range and leave it height by height, and so look like
// transient ones.
// Uses the sensors and frames of the recording, which may be only those about the path.
Rejection FlightRejection(const Recording& recording, const std::vector<Plot>& path,
                          const Queue<BodyBox>& bodies, const ReachesThreshold& reaches_threshold,
                          const RobustConfig& config);

// True if FlightRejection() knows that a path is no drone: few detections say nothing.
inline bool TellsNoDrone(Rejection rejection) {
  return rejection == Rejection::kNearGround || rejection == Rejection::kOnStructure ||
         rejection == Rejection::kStationary || rejection == Rejection::kWeakReturn;
}

}  // namespace unlidar
