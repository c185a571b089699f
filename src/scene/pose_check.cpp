#include "scene/pose_check.hpp"

#include <cmath>

#include "base/format.hpp"

namespace unlidar {

void PoseCheck::AddFrame(const SensorInfo& sensor, TimeNs time_ns, PointsView points_m) {
  up_.AddFrame(time_ns, points_m, sensor.origin_m);
  if (sensor.carrier == nullptr) motion_.AddFrame(time_ns, points_m, sensor.origin_m);
}

std::vector<Warning> PoseCheck::WarningsOf(const std::string& sensor) const {
  std::vector<Warning> warnings;
  if (const auto& motion = motion_.found()) {
    warnings.push_back(
        {"sensor_moves",
         sensor + ": the LiDAR moves (about " + FixedText(motion->velocity_mps.norm(), 1) +
             " m/s, " + FixedText(std::abs(motion->turn_deg_per_s), 0) +
             " degrees/s): drones are found only from one that stands still, or whose poses "
             "are known (--poses)"});
  }
  const auto up = up_.found();
  if (up && up->z() < -0.9F) {
    warnings.push_back(
        {"upside_down", sensor + ": upside down: the ground is above; z must point up (sensors." +
                            sensor + ".rotation), positions and tracks are wrong"});
  } else if (up) {
    std::string axes;
    for (const float value : *up) axes += (axes.empty() ? "" : ", ") + FixedText(value, 1);
    warnings.push_back(
        {"z_not_up", sensor + ": z does not point up: the ground says that up is about (" + axes +
                         "); turn it by sensors." + sensor +
                         ".rotation, positions and tracks are wrong"});
  }
  return warnings;
}

}  // namespace unlidar
