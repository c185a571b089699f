// Whether a sensor stands as tracking needs it: still, and with z up.
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "scene/ego_motion.hpp"
#include "scene/up_direction.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Of one sensor, in the common frame. Frames in, warnings out, each once:
//
//   upside_down   z points down
//   z_not_up      z points to another side
//   sensor_moves  the sensor moves
class PoseCheck {
 public:
  // A frame: its returns, and where the sensor stands.
  void AddFrame(const std::string& sensor, TimeNs time_ns, const Eigen::Vector3f* begin_m,
                const Eigen::Vector3f* end_m, const Eigen::Vector3f& origin_m);

  // No frame will follow.
  void Finish(const std::string& sensor);

  // What was found since this was last asked.
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
