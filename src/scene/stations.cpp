#include "scene/stations.hpp"

#include <algorithm>

namespace unlidar {
namespace {

constexpr float kMaxStationRadiusM = 2.0F;

}  // namespace

Stations::Stations(const std::vector<SensorInfo>& sensors) {
  for (std::uint32_t i = 0; i < sensors.size(); ++i) Add(i, sensors[i].origin_m);
}

std::size_t Stations::Add(std::uint32_t sensor, const Eigen::Vector3f& sensor_origin_m) {
  const auto is_near = [&](const Eigen::Vector3f& viewpoint_m) {
    return (sensor_origin_m - viewpoint_m).norm() <= kMaxStationRadiusM;
  };
  const auto known = std::find_if(viewpoints_m_.begin(), viewpoints_m_.end(), is_near);
  const auto station = static_cast<std::size_t>(known - viewpoints_m_.begin());
  if (known == viewpoints_m_.end()) {
    const Eigen::Vector3f common_m = Eigen::Vector3f::Zero();
    viewpoints_m_.push_back(is_near(common_m) ? common_m : sensor_origin_m);
  }
  station_of_.resize(std::max<std::size_t>(station_of_.size(), sensor + 1U));
  station_of_[sensor] = station;
  return station;
}

StationRecording RecordingOf(const Recording& whole, const Stations& stations,
                             std::size_t station) {
  StationRecording part;
  Recording& own = part.recording;
  own.sensors = whole.sensors;
  for (std::uint32_t f = 0; f < whole.frames.size(); ++f) {
    FrameInfo frame = whole.frames[f];
    if (stations.StationOf(frame.sensor) != station) continue;
    const auto first = static_cast<std::uint32_t>(own.points_m.size());
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      own.points_m.push_back(whole.points_m[i] - stations.ViewpointM(station));
      own.times_ns.push_back(whole.times_ns[i]);
    }
    frame.first_return = first;
    frame.last_return = static_cast<std::uint32_t>(own.points_m.size());
    own.frames.push_back(frame);
    part.frames.push_back(f);
  }
  return part;
}

}  // namespace unlidar
