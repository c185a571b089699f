// Times of the frames of each sensor, and their reversal for searches from the end to the
// beginning.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Frame times of each sensor.
struct ScanSchedule {
  struct Sensor {
    double frame_s = 0.1;                // duration of a frame
    std::vector<TimeNs> frame_times_ns;  // middles of the frames, ascending
  };
  std::vector<Sensor> sensors;

  std::uint32_t FramesBefore(std::uint32_t sensor, TimeNs time_ns) const {
    const std::vector<TimeNs>& times_ns = sensors[sensor].frame_times_ns;
    return static_cast<std::uint32_t>(std::lower_bound(times_ns.begin(), times_ns.end(), time_ns) -
                                      times_ns.begin());
  }
};

inline ScanSchedule ScanScheduleOf(const Recording& recording) {
  ScanSchedule scan_schedule;
  for (const SensorInfo& sensor : recording.sensors) {
    scan_schedule.sensors.push_back({SecondsOf(sensor.frame_period_ns), {}});
  }
  for (const FrameInfo& frame : recording.frames) {
    scan_schedule.sensors[frame.sensor].frame_times_ns.push_back(frame.middle_ns());
  }
  for (ScanSchedule::Sensor& sensor : scan_schedule.sensors) {
    std::sort(sensor.frame_times_ns.begin(), sensor.frame_times_ns.end());
  }
  return scan_schedule;
}

// Reverses the order of times without overflow; its own inverse.
inline TimeNs TimeReversed(TimeNs time_ns) { return ~time_ns; }

inline ScanSchedule TimeReversed(ScanSchedule scan_schedule) {
  for (ScanSchedule::Sensor& sensor : scan_schedule.sensors) {
    std::vector<TimeNs>& times_ns = sensor.frame_times_ns;
    std::reverse(times_ns.begin(), times_ns.end());
    for (TimeNs& time_ns : times_ns) time_ns = TimeReversed(time_ns);
  }
  return scan_schedule;
}

// Drops the returns, which no search uses.
inline Plot TimeReversed(const Plot& plot) {
  Plot time_reversed = plot;
  time_reversed.returns.clear();
  time_reversed.time_ns = TimeReversed(plot.time_ns);
  time_reversed.frame_time_ns = TimeReversed(plot.frame_time_ns);
  return time_reversed;
}

}  // namespace unlidar
