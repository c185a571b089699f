// Viewpoint of a sensor and the scene of its station.
#pragma once

#include <Eigen/Core>

#include "scene/occupancy.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {

// Viewpoint of a sensor, and the occupancy seen by its station, relative to that viewpoint.
struct StationModel {
  Eigen::Vector3f viewpoint_m;
  const TimeBins* bins;
  const Occupancy* occupancy;
};

// Returns the vector from the viewpoint to a place, m.
inline Eigen::Vector3d RayM(const StationModel& station, const Eigen::Vector3d& place_m) {
  return place_m - station.viewpoint_m.cast<double>();
}

}  // namespace unlidar
