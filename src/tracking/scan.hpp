// The plots of one frame, as a search takes them.
#pragma once

#include <cstddef>
#include <vector>

#include "base/point_tree.hpp"
#include "tracking/scan_schedule.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// A hypothesis is deleted where its track score falls below this, and not updated with a plot where
// it falls below the score of a birth there by this: re-initiation explains the plot better.
constexpr double kDeletionLog = -6.0;
constexpr double kReinitiationLog = -3.0;

// Indices are those of all plots.
struct Scan {
  struct Entry {
    double log_clutter;
    double score_threshold;  // least score of a hypothesis that is updated with it
    std::size_t plot;
  };

  std::size_t first = 0;        // its first plot
  std::size_t last = 0;         // past its last plot
  const Plot* plots = nullptr;  // [first, last), of the caller
  FrameTime at;
  FrameBounds bounds;
  PointTree<double> positions_m;
  std::vector<Entry> entries;  // in the order of positions_m.points_m()

  const Plot& PlotAt(std::size_t plot) const { return plots[plot - first]; }
};

// Fills `scan` with the first frame of `plots`, reusing its memory. They are all plots from number
// `first` on; `log_births` has one value for each of all plots.
void SetScan(const Plot* plots, std::size_t num_plots, const std::vector<double>& log_births,
             std::size_t first, const FrameTime& at, Scan* scan);

// Scans for searches through `plots`, which are in order of frame time. `log_births`: one per plot.
std::vector<Scan> ScansOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                          const ScanSchedule& scan_schedule);

}  // namespace unlidar
