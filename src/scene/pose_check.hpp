// Checks the pose that tracking requires of a sensor: at rest, or with known poses, and z up.
#pragma once

#include <string>
#include <vector>

#include "base/recording.hpp"
#include "scene/ego_motion.hpp"
#include "scene/up_direction.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Checks one sensor from its frames, in the common coordinate frame. Its warnings:
//
//   upside_down   z points down
//   z_not_up      z points in another direction
//   sensor_moves  the sensor moves, but has no poses
class PoseCheck {
 public:
  void AddFrame(const SensorInfo& sensor, TimeNs time_ns, PointsView points_m);

  // Completes the checks after the last frame.
  void Finish() { up_.Finish(); }

  // Returns the warnings so far.
  std::vector<Warning> WarningsOf(const std::string& sensor) const;

 private:
  UpDirection up_;
  EgoMotion motion_;
};

}  // namespace unlidar
