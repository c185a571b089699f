// When and from where each sensor looked.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Frame times and viewpoint of each sensor.
struct ScanSchedule {
  struct Sensor {
    double frame_s = 0.1;                                   // duration of a frame
    std::vector<TimeNs> frame_times_ns;                     // middles of the frames, ascending
    Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();  // of its station
  };
  std::vector<Sensor> sensors;

  std::uint32_t FramesBefore(std::uint32_t sensor, TimeNs time_ns) const;
};

ScanSchedule ScanScheduleOf(const Recording& recording);

}  // namespace unlidar
