// Point packets of Livox sensors, as they come by UDP: docs/livox.md has the layouts.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "unlidar/error.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Of the first ray's time. A sensor without a source of time counts from when it was switched on.
enum class LivoxClock { kPowerOn, kSynchronised };

// What the sensor counts its packets by, so that lost ones are found. Protocol 1 has none.
struct LivoxCounter {
  std::uint16_t packet = 0;  // 65535 is followed by 0
  std::uint8_t frame = 0;    // `packet` begins with 0 where it grows; of most sensors always 0
};

struct LivoxPoint {
  Eigen::Vector3f position_m = Eigen::Vector3f::Zero();  // zero: no return
  std::uint32_t ray = 0;                                 // below LivoxPacket::rays
};

struct LivoxPacket {
  // Of protocol 1: which LiDAR of a hub, and 1, 1 for a LiDAR of its own. Of protocol 2 both 0.
  std::uint8_t slot = 0;
  std::uint8_t lidar = 0;
  std::optional<LivoxCounter> counter;
  LivoxClock clock = LivoxClock::kPowerOn;
  TimeNs stamp_ns = 0;                  // of the first ray
  std::optional<std::int64_t> span_ns;  // from the first to the last ray, where the packet says it
  std::uint32_t rays = 0;               // evenly over the span; 0 for a packet of accelerations
  std::vector<LivoxPoint> points;       // in order of rays, up to three a ray
  std::uint32_t noise_points = 0;       // left out: their tag says that they are noise
};

// What is wrong with a packet, without a name of its sensor.
struct PacketError : InputError {
  using InputError::InputError;
};

// Takes one UDP payload of either protocol. Throws PacketError for any other: a length that does
// not follow from its header, a type of points or times that the protocol does not have, a checksum
// that is neither right nor 0 (not given), angles beyond their range, a time beyond the years 1970
// to 2096.
LivoxPacket ParseLivoxPacket(std::string_view payload);

}  // namespace unlidar
