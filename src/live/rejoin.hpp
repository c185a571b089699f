// Path of a reacquired target across the gap before it.
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

// Returns the path from the last confirmed plot of a target to the last of `plots`: the numbers of
// its plots in `plots`, and the hypothesis after each. As in a recording, the target may have been
// out of view, and short stretches of plots that lower the score are left out: the follower had to
// use some plot at least every max_gap_s, whether or not it was of the target.
std::vector<std::pair<std::size_t, Hypothesis>> RejoinedPlots(
    const TrackModel& model, const Hypothesis& confirmed, const std::vector<FollowedPlot>& plots);

}  // namespace unlidar
