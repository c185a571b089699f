#include "tracking/scan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace unlidar {

void SetScan(const Plot* plots, std::size_t num_plots, const std::vector<double>& log_births,
             std::size_t first, const FrameTime& at, Scan* scan) {
  scan->first = first;
  scan->plots = plots;
  scan->at = at;
  scan->entries.clear();
  scan->bounds = FrameBounds();
  std::size_t count = 0;
  for (; count < num_plots && plots[count].frame == plots[0].frame; ++count) {
    scan->bounds.Include(plots[count]);
  }
  scan->last = first + count;
  scan->positions_m.Reset(count, [&](std::size_t i) { return plots[i].position_m; });
  for (const std::uint32_t i : scan->positions_m.indices()) {
    scan->entries.push_back({plots[i].log_clutter,
                             std::max(kDeletionLog, log_births[first + i] + kReinitiationLog),
                             first + i});
  }
}

std::vector<Scan> ScansOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                          const ScanSchedule& scan_schedule) {
  std::vector<Scan> scans;
  for (std::size_t i = 0; i < plots.size(); i = scans.back().last) {
    scans.emplace_back();
    SetScan(&plots[i], plots.size() - i, log_births, i,
            FrameTimeOf(plots[i], plots.front().frame_time_ns, scan_schedule), &scans.back());
  }
  return scans;
}

}  // namespace unlidar
