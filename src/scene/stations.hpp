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

  // A sensor joins the first station whose viewpoint is within 2 m of it, which is the size of a
  // mount: what one sensor on it sees is much the same for all of them. Or it is a new station: one
  // that sees from the common origin, about which most mounts are calibrated, if that is as near.
  // Returns the station.
  std::size_t Add(std::uint32_t sensor, const Eigen::Vector3f& sensor_origin_m);

  std::size_t size() const { return viewpoints_m_.size(); }
  const Eigen::Vector3f& ViewpointM(std::size_t station) const { return viewpoints_m_[station]; }
  std::size_t StationOf(std::uint32_t sensor) const { return station_of_[sensor]; }

 private:
  std::vector<Eigen::Vector3f> viewpoints_m_;  // in the common frame
  std::vector<std::size_t> station_of_;        // (sensors) of those that were added
};

// A station's frames of a recording, with the returns relative to its viewpoint.
struct StationRecording {
  Recording recording;                // with all sensors of the whole
  std::vector<std::uint32_t> frames;  // which they are of the whole
};

StationRecording RecordingOf(const Recording& whole, const Stations& stations, std::size_t station);

}  // namespace unlidar
