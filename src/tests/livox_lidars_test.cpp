#include <gtest/gtest.h>

#include <chrono>
#include <set>
#include <string>

#include "io/input_limits.hpp"
#include "io/livox_receiver.hpp"
#include "tests/livox_packet_writer.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kBeginNs = 1'700'000'000'000'000'000;
constexpr TimeNs kFrameNs = 100'000'000;
constexpr std::uint32_t kFirst = 0xc0a80101;  // 192.168.1.1

// Packets as they come, `at_ms` after the beginning by every clock.
class Port {
 public:
  explicit Port(std::set<std::string> allowed = {})
      : lidars(std::move(allowed), kFrameNs, std::chrono::seconds(2)) {}

  // The sender, which is a sensor from its first frame on.
  LivoxLidar& Take(std::uint32_t source, std::int64_t at_ms, std::uint16_t rays = 1,
                   std::uint8_t tag = 0) {
    Header2 header;
    header.rays = rays;
    header.counter = counter++;
    header.stamp_ns = static_cast<std::uint64_t>(kBeginNs + at_ms * 1'000'000);
    const std::string point = Cartesian<std::int32_t>({1000, 1000, 1000}, tag);
    Datagram datagram;
    datagram.source = source;
    datagram.received_ns = kBeginNs;
    datagram.arrived = Datagram::Clock::time_point(std::chrono::milliseconds(at_ms));
    datagram.payload = Packet2(header, Repeated(point, rays), false);
    LivoxLidar* const lidar = lidars.Take(datagram);
    while (lidar->cutter.Next()) {
      if (!lidar->sensor) lidar->sensor = lidars.FreeSlot();
      if (!lidar->sensor) lidar->sensor = next_sensor++;
    }
    return *lidar;
  }

  LivoxLidars lidars;
  std::uint16_t counter = 0;
  std::uint32_t next_sensor = 0;
};

TEST(LivoxNames, AreTheAddressesAmongTheNamesOfSensors) {
  std::map<std::string, SensorConfig> sensors;
  for (const char* name : {"mid360", "192-168-1-12", "10-0-0-1-2-3", "1-2-3", "1-2-3-4-5",
                           "256-1-1-1", "01-2-3-4", "1-2-3-4-", "-1-2-3-4", "1-2-3-x"}) {
    sensors[name];
  }
  EXPECT_EQ(LivoxNames(sensors), (std::set<std::string>{"192-168-1-12", "10-0-0-1-2-3"}));
}

TEST(LivoxLidars, WhereSensorsNamesAddressesNobodyElseIsHeard) {
  Port port({"192-168-1-1"});
  for (std::uint32_t i = 1; i <= 3 * kMaxSensors; ++i) {
    EXPECT_THROW(port.Take(kFirst + i, 0), PacketError);
  }
  EXPECT_EQ(port.Take(kFirst, 0).name, "192-168-1-1");
}

TEST(LivoxLidars, SendersWithoutAWholeFrameGiveWayToTheNext) {
  Port port;
  port.Take(kFirst, 0);
  EXPECT_TRUE(port.Take(kFirst, 150).sensor);
  for (std::uint32_t i = 1; i <= 3 * kMaxSensors; ++i) port.Take(kFirst + i, 150);
  EXPECT_EQ(port.Take(kFirst, 300).cutter.counts().used, 3U);  // it kept its place
  EXPECT_EQ(port.lidars.forgotten_packets(), 2 * kMaxSensors + 1);
}

TEST(LivoxLidars, APlaceIsGivenUpByTheOneThatIsSilentForLongest) {
  Port port;
  for (const std::int64_t at_ms : {0, 150}) {
    for (std::uint32_t i = 0; i < kMaxSensors; ++i) port.Take(kFirst + i, at_ms);
  }
  EXPECT_EQ(port.next_sensor, kMaxSensors);
  EXPECT_THROW(port.Take(kFirst + 1000, 1000), PacketError);
  for (std::uint32_t i = 0; i < kMaxSensors; ++i) {
    if (i != 7) port.Take(kFirst + i, 2100);
  }
  port.Take(kFirst + 1000, 2200);
  EXPECT_EQ(port.Take(kFirst + 1000, 2350).sensor, 7U);
  EXPECT_EQ(port.next_sensor, kMaxSensors);
}

TEST(LivoxLidars, UnfinishedFramesOfAllTogetherAreBounded) {
  Port port;
  const auto used = [&](std::uint32_t i) { return port.Take(kFirst + i, 1).cutter.counts().used; };
  constexpr std::uint16_t kRays = 140;  // of one datagram
  std::size_t most = 0;
  for (int k = 0; k < 8'000; ++k) {
    for (std::uint32_t i = 1; i <= 16; ++i) port.Take(kFirst + i, 1, kRays);
    if (k % 100 == 0) port.Take(kFirst, k / 100, kRays);  // whom nobody crowds out
    most = std::max(most, port.lidars.unfinished_bytes());
  }
  EXPECT_LE(most, kMaxUnfinishedBytes);
  EXPECT_GT(most, kMaxUnfinishedBytes / 2);
  EXPECT_EQ(used(0), 81U);
}

TEST(LivoxLidars, PacketsWithoutAPointLeftAreBoundedAsOthersAre) {
  Port port;
  for (std::size_t k = 0; k < kMaxFrameParts + 100; ++k) port.Take(kFirst, 1, 1, 2);
  const LivoxCounts& counts = port.Take(kFirst, 1, 1, 2).cutter.counts();
  EXPECT_EQ(counts.used, kMaxFrameParts);
  EXPECT_EQ(counts.excess, 101U);
}

}  // namespace
}  // namespace unlidar
