#include "tracking/backwards.hpp"

#include <algorithm>

namespace unlidar {

Watch Backwards(Watch watch) {
  for (Watch::Sensor& sensor : watch.sensors) {
    std::vector<TimeNs>& times_ns = sensor.frame_times_ns;
    std::reverse(times_ns.begin(), times_ns.end());
    for (TimeNs& time_ns : times_ns) time_ns = Backwards(time_ns);
  }
  return watch;
}

Plot Backwards(const Plot& plot) {
  Plot backwards = plot;
  backwards.returns.clear();
  backwards.time_ns = Backwards(plot.time_ns);
  backwards.frame_time_ns = Backwards(plot.frame_time_ns);
  return backwards;
}

}  // namespace unlidar
