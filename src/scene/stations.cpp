#include "scene/stations.hpp"

#include <algorithm>

namespace unlidar {

Stations::Stations(const std::vector<SensorInfo>& sensors) {
  for (std::uint32_t i = 0; i < sensors.size(); ++i) Add(i, sensors[i]);
}

std::size_t Stations::Add(std::uint32_t sensor, const SensorInfo& info) {
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

}  // namespace unlidar
