#include "tracking/time_reversed.hpp"

#include <algorithm>

namespace unlidar {

ScanSchedule TimeReversed(ScanSchedule scan_schedule) {
  for (ScanSchedule::Sensor& sensor : scan_schedule.sensors) {
    std::vector<TimeNs>& times_ns = sensor.frame_times_ns;
    std::reverse(times_ns.begin(), times_ns.end());
    for (TimeNs& time_ns : times_ns) time_ns = TimeReversed(time_ns);
  }
  return scan_schedule;
}

Plot TimeReversed(const Plot& plot) {
  Plot time_reversed = plot;
  time_reversed.returns.clear();
  time_reversed.time_ns = TimeReversed(plot.time_ns);
  time_reversed.frame_time_ns = TimeReversed(plot.frame_time_ns);
  return time_reversed;
}

}  // namespace unlidar
