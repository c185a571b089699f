// What a sensor's station knows of the scene.
#pragma once

#include <Eigen/Core>

#include "robust/scene/background.hpp"

namespace unlidar {

// From where a sensor sees, and what is known of the places that its station sees, relative to it.
struct SensorView {
  Eigen::Vector3f viewpoint_m;
  const Background* background;
};

}  // namespace unlidar
