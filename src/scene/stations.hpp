// Stations: groups of sensors that share one viewpoint, and what one has learned.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/occupancy.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {

// Size of a mount: its sensors have nearly the same view.
inline constexpr float kMaxStationRadiusM = 2.0F;

// Assigns sensors to stations. Ranges, directions and occlusion are specific to a station.
class Stations {
 public:
  Stations() = default;
  explicit Stations(const std::vector<SensorInfo>& sensors) {
    for (std::uint32_t i = 0; i < sensors.size(); ++i) Add(i, sensors[i]);
  }

  // Adds a sensor to the first station of its carrier whose viewpoint is within kMaxStationRadiusM.
  // Otherwise creates a station; its viewpoint is the common origin, about which most mounts are
  // calibrated, if within that radius, else the sensor's origin. Returns the index of the station.
  std::size_t Add(std::uint32_t sensor, const SensorInfo& info) {
    const auto is_near = [&](const Eigen::Vector3f& viewpoint_m) {
      return (info.origin_m - viewpoint_m).norm() <= kMaxStationRadiusM;
    };
    std::size_t station = 0;
    while (station < size() &&
           !(carriers_[station] == info.carrier && is_near(viewpoints_m_[station]))) {
      ++station;
    }
    if (station == size()) {
      const Eigen::Vector3f common_m = Eigen::Vector3f::Zero();
      viewpoints_m_.push_back(is_near(common_m) ? common_m : info.origin_m);
      carriers_.push_back(info.carrier);
    }
    station_of_.resize(std::max<std::size_t>(station_of_.size(), sensor + 1U));
    station_of_[sensor] = station;
    return station;
  }

  std::size_t size() const { return viewpoints_m_.size(); }
  const Eigen::Vector3f& ViewpointM(std::size_t station) const { return viewpoints_m_[station]; }
  std::size_t StationOf(std::uint32_t sensor) const { return station_of_[sensor]; }

 private:
  std::vector<Eigen::Vector3f> viewpoints_m_;  // in the common frame, at their first frames
  std::vector<const void*> carriers_;          // see SensorInfo
  std::vector<std::size_t> station_of_;        // (sensors) valid for added sensors
};

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
