// Stations: sensors that stand together and see a scene from one viewpoint.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Ranges, directions and what hides what are one station's own.
class Stations {
 public:
  Stations() = default;
  explicit Stations(const std::vector<SensorInfo>& sensors);

  // The next sensor joins the first station that stands within 2 m of it (so far apart, what is
  // seen from a sensor's mount is seen alike by all that are on it), or is a new one. The common
  // origin, where it is that near, is the viewpoint: most stations are calibrated about it.
  void Add(const Eigen::Vector3f& sensor_origin_m);

  std::size_t size() const { return viewpoints_m_.size(); }
  const Eigen::Vector3f& ViewpointM(std::size_t station) const { return viewpoints_m_[station]; }
  std::size_t StationOf(std::uint32_t sensor) const { return station_of_[sensor]; }

 private:
  std::vector<Eigen::Vector3f> viewpoints_m_;  // in the common frame
  std::vector<std::size_t> station_of_;        // (sensors)
};

// A station's frames of a recording, with the returns relative to its viewpoint.
struct StationRecording {
  Recording recording;                // with all sensors of the whole
  std::vector<std::uint32_t> frames;  // which they are of the whole
};

StationRecording RecordingOf(const Recording& whole, const Stations& stations, std::size_t station);

}  // namespace unlidar
