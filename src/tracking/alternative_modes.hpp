// Where a target may have been if its path went astray: the other ways in which it may have gone
// on.
#pragma once

#include <cstddef>
#include <vector>

#include "base/recording.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {

// About the ends of one of these paths, frame by frame, in order of time. A path is the likeliest
// of all ways. Where it brings little, others bring nearly as much: to go on with other plots, or
// to go unseen since an earlier one. What is before the last plots that bring `birth_cost` together
// is not doubted. What other paths hold is not the target's. Its measurements before and behind the
// path make that likelier than all other ways, by their ratios.
std::vector<AlternativeMode> AlternativeModesOf(std::size_t path, const std::vector<Path>& paths,
                                                const std::vector<Plot>& plots,
                                                const ScanSchedule& scan_schedule,
                                                const TrackerConfig& config,
                                                const std::vector<Measurement>& measurements);

}  // namespace unlidar
