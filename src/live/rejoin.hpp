// The way of a reacquired target across a gap.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "live/live_plot.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// A plot that may belong to a track.
struct FollowedPlot {
  LivePlot seen;
  FrameTime at;  // of its frame
};

// Returns the plots, by their numbers in `plots`, by which a target came from its last confirmed
// plot to the last of these, and its hypothesis after each of them. As for a path of a recording,
// it may have been out of view, and short stretches of plots that lower the score are left out: the
// target was followed across the gap by whatever was there, and beyond max_gap_s by nothing else.
std::vector<std::pair<std::size_t, Hypothesis>> RejoinedPlots(
    const TrackModel& model, const Hypothesis& confirmed, const std::vector<FollowedPlot>& plots);

}  // namespace unlidar
