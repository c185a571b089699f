// The history of a flight from before the search found it.
#pragma once

#include <cstdint>
#include <vector>

#include "live/live_plot.hpp"
#include "live/recent_frame_times.hpp"
#include "tracking/track_model.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Follows a flight back in time, as a track is followed forward. Plots that the search left out,
// because they scored no better than clutter then, join it where they match the prediction.
// `seen`: plots in order of time, including those of the flight; `are_free` (seen): true if no
// track has the plot; `frame_times`: of their frames; `num_frames` (sensors): up to now. Returns
// the indices of plots before the flight, in order of time.
std::vector<std::uint32_t> ExtendBackwards(const Flight& flight, const RecentPlots& seen,
                                           const std::vector<char>& are_free,
                                           const RecentFrameTimes& frame_times,
                                           const std::vector<std::uint32_t>& num_frames,
                                           const std::vector<TrackModel>& models,
                                           const Config& config);

}  // namespace unlidar
