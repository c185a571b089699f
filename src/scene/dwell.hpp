// Dwells: how long what is at a place now has been there.
#pragma once

#include "scene/recent_bins.hpp"

namespace unlidar {

// Bins around one, from the youngest to the oldest.
struct Dwell {
  int youngest;
  int oldest;
};

// Returns the dwell around the bin of age `at`, with breaks of at most `max_break` bins.
Dwell DwellAt(const RecentBins& hits, int at, int max_break);

}  // namespace unlidar
