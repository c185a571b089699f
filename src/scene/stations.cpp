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

}  // namespace unlidar
