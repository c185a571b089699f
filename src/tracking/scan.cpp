#include "tracking/scan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace unlidar {

void SetScan(const std::vector<Plot>& plots, const std::vector<double>& log_births,
             std::size_t first, const FrameTime& at, Scan* scan) {
  scan->first = scan->last = first;
  scan->at = at;
  scan->entries.clear();
  FrameBounds& bounds = scan->bounds;
  bounds = FrameBounds();
  bounds.min_variance_m2 = plots[first].variance_m2;
  bounds.streak_s = plots[first].streak_s;
  std::size_t& last = scan->last;
  for (; last < plots.size() && plots[last].frame == plots[first].frame; ++last) {
    const Plot& plot = plots[last];
    bounds.min_variance_m2 = std::min(bounds.min_variance_m2, plot.variance_m2);
    bounds.max_variance_m2 = std::max(bounds.max_variance_m2, plot.variance_m2);
    bounds.half_span_s =
        std::max(bounds.half_span_s,
                 static_cast<double>(std::abs(plot.time_ns - plot.frame_time_ns)) * kSecondsPerNs);
  }
  scan->positions_m.Reset(last - first, [&](std::size_t i) { return plots[first + i].position_m; });
  for (const std::uint32_t index : scan->positions_m.indices()) {
    const std::size_t plot = first + index;
    scan->entries.push_back({plots[plot].log_clutter,
                             std::max(kDeletionLog, log_births[plot] + kReinitiationLog), plot});
  }
}

std::vector<Scan> ScansOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                          const ScanSchedule& scan_schedule) {
  std::vector<Scan> scans;
  for (std::size_t i = 0; i < plots.size(); i = scans.back().last) {
    scans.emplace_back();
    SetScan(plots, log_births, i, FrameTimeOf(plots[i], plots.front().frame_time_ns, scan_schedule),
            &scans.back());
  }
  return scans;
}

}  // namespace unlidar
