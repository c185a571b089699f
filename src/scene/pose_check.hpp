// Checks the pose that tracking requires of a sensor: at rest, or with known poses, and z up.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "base/recording.hpp"
#include "scene/ego_motion.hpp"
#include "scene/up_direction.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Checks one sensor from its frames, in the common coordinate frame. Emits each warning once:
//
//   upside_down   z points down
//   z_not_up      z points in another direction
//   sensor_moves  the sensor moves, but has no poses
class PoseCheck {
 public:
  void AddFrame(const SensorInfo& sensor, TimeNs time_ns, PointsView points_m);

  // Completes the checks after the last frame.
  void Finish(const std::string& sensor);

  // Returns the warnings since the last call.
  std::vector<Warning> TakeWarnings() { return std::exchange(warnings_, {}); }

 private:
  void Warn(const std::string& sensor);

  UpDirection up_;
  EgoMotion motion_;
  bool has_warned_up_ = false;
  bool has_warned_motion_ = false;
  std::vector<Warning> warnings_;
};

}  // namespace unlidar
