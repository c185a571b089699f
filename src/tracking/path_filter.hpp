// Hypotheses along a path of known plots.
#pragma once

#include <cstddef>
#include <vector>

#include "scene/plots.hpp"
#include "tracking/track_model.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Returns a hypothesis, then that after each further plot of a path, from number `first` on.
// `frame_times` (plots): of their frames.
std::vector<Hypothesis> FilterFrom(const TrackModel& model, const Hypothesis& from,
                                   const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, std::size_t first);

// Filters a path: returns the hypothesis after each plot (plots), for the initial speed with the
// highest final score.
std::vector<Hypothesis> FilterPath(const TrackModel& model, const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, double log_birth,
                                   const TrackerConfig& config);

}  // namespace unlidar
