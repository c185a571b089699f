// Point packets of Livox sensors, received by UDP; layouts in docs/livox.md.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "unlidar/error.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Clock of the packet stamps. A sensor without time synchronisation counts from power-on.
enum class LivoxClock { kPowerOn, kSynchronised };

// Packet counter of the sensor, to detect lost packets. Protocol 1 has none.
struct LivoxCounter {
  std::uint16_t packet = 0;  // 65535 wraps to 0
  std::uint8_t frame = 0;    // `packet` restarts at 0 when it grows; always 0 on most sensors
};

struct LivoxPoint {
  Eigen::Vector3f position_m = Eigen::Vector3f::Zero();  // zero: no return
  std::uint32_t ray = 0;                                 // below LivoxPacket::rays
};

struct LivoxPacket {
  // Protocol 1: LiDAR of a hub, or 1, 1 for a standalone LiDAR. Protocol 2: both 0.
  std::uint8_t slot = 0;
  std::uint8_t lidar = 0;
  std::optional<LivoxCounter> counter;
  LivoxClock clock = LivoxClock::kPowerOn;
  TimeNs stamp_ns = 0;                  // time of the first ray
  std::optional<std::int64_t> span_ns;  // from the first to the last ray, if stated
  std::uint32_t rays = 0;               // evenly spaced over the span; 0 for accelerations
  std::vector<LivoxPoint> points;       // in order of rays, up to three per ray
  std::uint32_t noise_points = 0;       // dropped: tagged as noise
};

// States why a packet is invalid, without the name of its sensor.
struct PacketError : InputError {
  using InputError::InputError;
};

// Parses one UDP payload of either protocol. Throws PacketError for any other: a length that
// contradicts its header, a data or time type that the protocol does not have, a checksum that is
// neither right nor 0 (not given), angles out of range, a time outside the years 1970 to 2096.
LivoxPacket ParseLivoxPacket(std::string_view payload);

}  // namespace unlidar
