// What a flight was before the search found it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "live/live_plot.hpp"
#include "live/recent_frame_times.hpp"
#include "tracking/track_model.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Without a plot for so long: what was no track before has no part in one after it.
inline constexpr double kLongPauseS = 3.0;

// The plots from which a flight came: it is followed back in time, as a track is followed forth.
// What the search left out, as it was no better than clutter by what was known then, is its own if
// it is where it must have been. `seen`: plots in order of time, among them those of the flight;
// `are_free` (seen): which no track has; `frame_times`: of their frames; `num_frames` (sensors):
// until now. Returns indices of plots before the flight, in order of time.
std::vector<std::size_t> ExtendBackwards(const Flight& flight, const std::vector<LivePlot>& seen,
                                         const std::vector<char>& are_free,
                                         const RecentFrameTimes& frame_times,
                                         const std::vector<std::uint32_t>& num_frames,
                                         const std::vector<TrackModel>& models,
                                         const Config& config);

}  // namespace unlidar
