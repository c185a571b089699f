// Stations: groups of sensors that share one viewpoint.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Size of a mount: its sensors have nearly the same view.
inline constexpr float kMaxStationRadiusM = 2.0F;

// Assigns sensors to stations. Ranges, directions and occlusion are specific to a station.
class Stations {
 public:
  Stations() = default;
  explicit Stations(const std::vector<SensorInfo>& sensors);

  // Adds a sensor to the first station of its carrier whose viewpoint is within kMaxStationRadiusM.
  // Otherwise creates a station; its viewpoint is the common origin, about which most mounts are
  // calibrated, if within that radius, else the sensor's origin. Returns the index of the station.
  std::size_t Add(std::uint32_t sensor, const SensorInfo& info);

  std::size_t size() const { return viewpoints_m_.size(); }
  const Eigen::Vector3f& ViewpointM(std::size_t station) const { return viewpoints_m_[station]; }
  std::size_t StationOf(std::uint32_t sensor) const { return station_of_[sensor]; }

 private:
  std::vector<Eigen::Vector3f> viewpoints_m_;  // in the common frame, at their first frames
  std::vector<const void*> carriers_;          // see SensorInfo
  std::vector<std::size_t> station_of_;        // (sensors) valid for added sensors
};

}  // namespace unlidar
