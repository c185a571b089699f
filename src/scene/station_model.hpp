// What a sensor's station knows of the scene.
#pragma once

#include <Eigen/Core>

#include "scene/background.hpp"

namespace unlidar {

// From where a sensor sees, and what is known of the places that its station sees, relative to it.
struct StationModel {
  Eigen::Vector3f viewpoint_m;
  const Background* background;
};

// From where a sensor sees to a place.
inline Eigen::Vector3d RayM(const StationModel& station, const Eigen::Vector3d& place_m) {
  return place_m - station.viewpoint_m.cast<double>();
}

}  // namespace unlidar
