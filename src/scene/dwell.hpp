// Dwells: how long what is at a place now has been there.
#pragma once

#include "scene/recent_bins.hpp"

namespace unlidar {

// Bins around one, from the youngest to the oldest.
struct Dwell {
  int youngest;
  int oldest;
  int num_hits;  // bins with returns, that one included

  int length() const { return oldest - youngest + 1; }
};

// Returns the dwell around the bin of age `at`: runs of hits with breaks of at most `max_break`
// bins, and those that follow each other by chance: method.md section 1.
Dwell DwellAt(const RecentBins& hits, int at, int max_break);

// Returns the longest break, in bins, that is no end of a dwell: one that such a dwell has by
// chance, at least `max_break`. The sparser the returns of what stays at a place, the longer it is.
int LongestBreak(int num_hits, int length, int max_break);

}  // namespace unlidar
