// Gates on a path beyond its score: detections, height and return rate.
#pragma once

#include <cstddef>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/rejection.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// True if the plots are of at least `min_frames` frames; two plots of one frame count once.
bool HasMinFrames(const std::vector<Plot>& path, int min_frames);

// Returns the height above ground that people and cars do not reach and a path must exceed. It is
// lower if the returns show that the path is no part of a body that stands below it. Objects that
// are there at other times as well, by the returns that the recording keeps, are no evidence of a
// body. `bodies`: in order of time.
double MinFlightHeightM(const Recording& recording, const std::vector<Plot>& path,
                        const Queue<BodyBox>& bodies, const RobustConfig& config);

// Returns the number of plots up to the last one that is as low as people and cars.
std::size_t NumToLastLow(const std::vector<Plot>& path, const RobustConfig& config);

// A target that moves farther is neither at rest nor suspended.
constexpr RangeRadius kMinDisplacement{0.8, 0.02};

// Returns the distance between the means of the first and the last third of the plots.
double DriftM(const std::vector<Plot>& path);

// Returns kNone for a path that has enough detections, is off the ground and has the return rate of
// a drone. Seen from a carrier that travels meanwhile, it must also move over the ground: static
// objects come into range and leave it height by height, and so look like transient ones.
// Uses the sensors and frames of the recording, which may be only those about the path.
Rejection FlightRejection(const Recording& recording, const std::vector<Plot>& path,
                          const Queue<BodyBox>& bodies, const RobustConfig& config);

}  // namespace unlidar
