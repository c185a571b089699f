// Times of the frames of each sensor, and their reversal for searches from the end to the
// beginning.
#pragma once

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

  std::uint32_t FramesBefore(std::uint32_t sensor, TimeNs time_ns) const;
};

ScanSchedule ScanScheduleOf(const Recording& recording);

// Reverses the order of times without overflow; its own inverse.
inline TimeNs TimeReversed(TimeNs time_ns) { return ~time_ns; }

ScanSchedule TimeReversed(ScanSchedule scan_schedule);

// Drops the returns, which no search uses.
Plot TimeReversed(const Plot& plot);

}  // namespace unlidar
