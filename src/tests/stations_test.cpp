#include "scene/stations.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace unlidar {
namespace {

std::vector<SensorInfo> SensorsAt(const std::vector<Eigen::Vector3f>& origins_m) {
  std::vector<SensorInfo> sensors(origins_m.size());
  for (std::size_t i = 0; i < sensors.size(); ++i) sensors[i].origin_m = origins_m[i];
  return sensors;
}

TEST(Stations, SensorsNearTheCommonOriginSeeFromThere) {
  const Stations stations(SensorsAt({{0.2F, 0, -0.1F}, {-1.5F, 0.5F, 1.0F}, {0, 0, 0}}));
  ASSERT_EQ(stations.size(), 1U);
  EXPECT_EQ(stations.ViewpointM(0), Eigen::Vector3f(0, 0, 0));
  for (const std::uint32_t sensor : {0U, 1U, 2U}) EXPECT_EQ(stations.StationOf(sensor), 0U);
}

TEST(Stations, WhatStandsMetresApartIsAnother) {
  const Stations stations(SensorsAt({{60, 8, 1}, {0, 0, 0}, {60, 9, 1}, {60, 8, 4}}));
  ASSERT_EQ(stations.size(), 3U);
  EXPECT_EQ(stations.ViewpointM(0), Eigen::Vector3f(60, 8, 1));
  EXPECT_EQ(stations.ViewpointM(1), Eigen::Vector3f(0, 0, 0));
  EXPECT_EQ(stations.ViewpointM(2), Eigen::Vector3f(60, 8, 4));
  EXPECT_EQ(stations.StationOf(0), 0U);
  EXPECT_EQ(stations.StationOf(1), 1U);
  EXPECT_EQ(stations.StationOf(2), 0U);
  EXPECT_EQ(stations.StationOf(3), 2U);
}

TEST(Stations, WhatIsCarriedAlongIsAnother) {
  std::vector<SensorInfo> sensors = SensorsAt({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  const int carrier = 0;
  sensors[1].carrier = sensors[2].carrier = &carrier;
  const Stations stations(sensors);
  ASSERT_EQ(stations.size(), 2U);
  EXPECT_EQ(stations.StationOf(0), 0U);
  EXPECT_EQ(stations.StationOf(1), 1U);
  EXPECT_EQ(stations.StationOf(2), 1U);
}

}  // namespace
}  // namespace unlidar
