// Viewpoint of a sensor and the scene of its station.
#pragma once

#include <Eigen/Core>

#include "base/recording.hpp"
#include "scene/occupancy.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {

// Viewpoint of a sensor at its first frame, and the occupancy seen by its station, relative to it.
struct StationModel {
  Eigen::Vector3f viewpoint_m;
  const TimeBins* bins;
  const Occupancy* occupancy;
};

// Returns where a frame was seen from.
inline Eigen::Vector3d ViewpointM(const StationModel& station, const FrameInfo& frame) {
  return (station.viewpoint_m + frame.carrier.shift_m).cast<double>();
}

// Returns the vector from the viewpoint of a frame to a place, m.
inline Eigen::Vector3d RayM(const StationModel& station, const FrameInfo& frame,
                            const Eigen::Vector3d& place_m) {
  return place_m - ViewpointM(station, frame);
}

}  // namespace unlidar
