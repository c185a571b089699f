// Alternative modes: other continuations of a path that are nearly as likely as the reported one.
#pragma once

#include <cstddef>
#include <vector>

#include "base/recording.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {

// Returns the alternative modes about both ends of one path, one per frame, in order of time. The
// path is the likeliest continuation; where it gains little, others gain nearly as much: to
// continue with other plots, or to be missed since an earlier one. The part of the path before its
// last plots that together gain kInitiationLog is taken as certain. Plots of other paths are
// excluded. Measurements before and after the path favour it over all other continuations, by their
// log ratios.
std::vector<AlternativeMode> AlternativeModesOf(std::size_t path, const std::vector<Path>& paths,
                                                const std::vector<Plot>& plots,
                                                const ScanSchedule& scan_schedule,
                                                const TrackerConfig& config,
                                                const std::vector<Measurement>& measurements);

}  // namespace unlidar
