#include "io/livox_packets.hpp"

#include <array>
#include <boost/crc.hpp>
#include <cmath>
#include <cstddef>
#include <ctime>
#include <string>

#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "base/recording.hpp"
#include "io/frame_directory.hpp"

namespace unlidar {
namespace {

constexpr std::uint8_t kVersion1 = 5;
constexpr std::uint8_t kVersion2 = 0;
constexpr std::size_t kHeaderBytes1 = 18;
constexpr std::size_t kHeaderBytes2 = 36;
constexpr std::size_t kCheckedFrom2 = 28;  // time and points, after the checksum

constexpr double kRadPerHundredthDegree = 3.14159265358979323846 / 18000.0;

[[noreturn]] void Fail(const std::string& what) { throw PacketError(what); }

// Reads a number; the payload must be long enough.
template <class Number>
Number Get(std::string_view bytes, std::size_t at) {
  return LoadAs<Number>(bytes.data() + at);
}

enum class Coordinates { kMillimetres, kCentimetres, kSpherical, kSharedAngles, kAccelerations };

// Layout of the points of a data type.
struct Layout {
  Coordinates coordinates;
  std::uint32_t returns_per_ray;
  bool has_tag;
  std::uint32_t rays;  // per packet; in protocol 2 a packet states its own
};

std::size_t ReturnBytes(const Layout& layout) {
  constexpr std::array<std::size_t, 5> kCoordinateBytes = {12, 6, 8, 4, 24};
  const std::size_t bytes = kCoordinateBytes[static_cast<std::size_t>(layout.coordinates)];
  if (layout.coordinates == Coordinates::kAccelerations) return bytes;
  return bytes + (layout.has_tag ? 2 : 1);  // reflectivity, tag
}

std::size_t RayBytes(const Layout& layout) {
  const std::size_t angles = layout.coordinates == Coordinates::kSharedAngles ? 4 : 0;
  return angles + layout.returns_per_ray * ReturnBytes(layout);
}

// Layouts of protocol 1 by data type.
constexpr std::array<Layout, 9> kLayouts1 = {{{Coordinates::kMillimetres, 1, false, 100},
                                              {Coordinates::kSpherical, 1, false, 100},
                                              {Coordinates::kMillimetres, 1, true, 96},
                                              {Coordinates::kSpherical, 1, true, 96},
                                              {Coordinates::kMillimetres, 2, true, 48},
                                              {Coordinates::kSharedAngles, 2, true, 48},
                                              {Coordinates::kAccelerations, 1, false, 1},
                                              {Coordinates::kMillimetres, 3, true, 30},
                                              {Coordinates::kSharedAngles, 3, true, 30}}};
constexpr std::array<Layout, 4> kLayouts2 = {{{Coordinates::kAccelerations, 1, false, 0},
                                              {Coordinates::kMillimetres, 1, true, 0},
                                              {Coordinates::kCentimetres, 1, true, 0},
                                              {Coordinates::kSpherical, 1, true, 0}}};
constexpr std::uint8_t kTwoReturns2 = 17;

Layout Layout1(std::uint8_t type) {
  if (type < kLayouts1.size()) return kLayouts1[type];
  Fail("has the data type " + std::to_string(type) + ", expected 0 to 8");
}

Layout Layout2(std::uint8_t type, std::uint16_t rays) {
  if (type == kTwoReturns2) return {Coordinates::kMillimetres, 2, true, rays};
  if (type >= kLayouts2.size()) {
    Fail("has the data type " + std::to_string(type) + ", expected 0 to 3, or 17");
  }
  Layout layout = kLayouts2[type];
  layout.rays = rays;
  return layout;
}

Eigen::Vector3f FromAngles(std::uint32_t depth_mm, std::uint16_t zenith, std::uint16_t azimuth) {
  if (zenith > 18000 || azimuth > 36000) {
    Fail("has a point at the angles " + std::to_string(zenith) + ", " + std::to_string(azimuth) +
         ", expected up to 18000 and 36000 hundredths of a degree");
  }
  const double depth_m = depth_mm * 1e-3;
  const double theta = zenith * kRadPerHundredthDegree;
  const double phi = azimuth * kRadPerHundredthDegree;
  const double across_m = depth_m * std::sin(theta);
  return Eigen::Vector3d(across_m * std::cos(phi), across_m * std::sin(phi),
                         depth_m * std::cos(theta))
      .cast<float>();
}

// `angles`, `at`: byte offsets of the ray's shared angles and of the return.
Eigen::Vector3f Position(Coordinates coordinates, std::string_view bytes, std::size_t angles,
                         std::size_t at) {
  const auto cartesian = [&](auto unit, double scale_m) {
    using Number = decltype(unit);
    const Eigen::Vector3d units(Get<Number>(bytes, at), Get<Number>(bytes, at + sizeof(Number)),
                                Get<Number>(bytes, at + 2 * sizeof(Number)));
    return Eigen::Vector3f((units * scale_m).cast<float>());
  };
  switch (coordinates) {
    case Coordinates::kMillimetres:
      return cartesian(std::int32_t{}, 1e-3);
    case Coordinates::kCentimetres:
      return cartesian(std::int16_t{}, 1e-2);
    case Coordinates::kSpherical:
      return FromAngles(Get<std::uint32_t>(bytes, at), Get<std::uint16_t>(bytes, at + 4),
                        Get<std::uint16_t>(bytes, at + 6));
    case Coordinates::kSharedAngles:
      return FromAngles(Get<std::uint32_t>(bytes, at), Get<std::uint16_t>(bytes, angles),
                        Get<std::uint16_t>(bytes, angles + 2));
    case Coordinates::kAccelerations:
      break;
  }
  return Eigen::Vector3f::Zero();
}

// The tag has two groups of two bits: dust and rain by echo intensity, and points between two
// objects. `worst`: the value for the most certain noise in a protocol.
bool IsNoise(std::uint8_t tag, std::uint8_t worst) {
  return (tag & 3U) == worst || ((tag >> 2U) & 3U) == worst;
}

void ReadPoints(const Layout& layout, std::string_view bytes, std::uint8_t worst_tag,
                LivoxPacket& packet) {
  if (layout.coordinates == Coordinates::kAccelerations) return;
  packet.rays = layout.rays;
  packet.points.reserve(std::size_t{layout.rays} * layout.returns_per_ray);
  const std::size_t return_bytes = ReturnBytes(layout);
  const std::size_t ray_bytes = RayBytes(layout);
  const std::size_t first = ray_bytes - layout.returns_per_ray * return_bytes;
  for (std::uint32_t ray = 0; ray < layout.rays; ++ray) {
    const std::size_t angles = ray * ray_bytes;
    for (std::uint32_t k = 0; k < layout.returns_per_ray; ++k) {
      const std::size_t at = angles + first + k * return_bytes;
      const Eigen::Vector3f position_m = Position(layout.coordinates, bytes, angles, at);
      if (layout.has_tag &&
          IsNoise(static_cast<std::uint8_t>(bytes[at + return_bytes - 1]), worst_tag)) {
        ++packet.noise_points;
      } else {
        packet.points.push_back({position_m, ray});
      }
    }
  }
}

void CheckLength(std::string_view payload, std::size_t expected) {
  if (payload.size() == expected) return;
  Fail("has " + Count(payload.size(), "byte") + ", expected " + std::to_string(expected) +
       " by its header");
}

TimeNs Stamp(std::uint64_t ns) {
  if (ns > static_cast<std::uint64_t>(kMaxStampNs)) {
    Fail("has the time " + std::to_string(ns) + " ns, expected a year up to 2096");
  }
  return static_cast<TimeNs>(ns);
}

// Reads year since 2000, month, day, hour, and microseconds of the hour.
TimeNs UtcStamp(std::string_view payload, std::size_t at) {
  const auto byte = [&](std::size_t i) { return Get<std::uint8_t>(payload, at + i); };
  const auto us = Get<std::uint32_t>(payload, at + 4);
  if (byte(0) > 95 || byte(1) < 1 || byte(1) > 12 || byte(2) < 1 || byte(2) > 31 || byte(3) > 23 ||
      us >= 3'600'000'000U) {
    Fail("has a date that is none, expected year, month, day, hour and microseconds");
  }
  std::tm hour{};
  hour.tm_year = 100 + byte(0);
  hour.tm_mon = byte(1) - 1;
  hour.tm_mday = byte(2);
  hour.tm_hour = byte(3);
  return std::int64_t{::timegm(&hour)} * kNsPerSecond + std::int64_t{us} * 1000;
}

LivoxPacket Parse1(std::string_view payload) {
  const Layout layout = Layout1(Get<std::uint8_t>(payload, 9));
  CheckLength(payload, kHeaderBytes1 + layout.rays * RayBytes(layout));
  LivoxPacket packet;
  packet.slot = Get<std::uint8_t>(payload, 1);
  packet.lidar = Get<std::uint8_t>(payload, 2);
  const auto time_type = Get<std::uint8_t>(payload, 8);
  if (time_type != 0 && time_type != 1 && time_type != 3) {  // pulses alone carry no time
    Fail("has the time type " + std::to_string(time_type) + ", expected 0, 1 or 3");
  }
  packet.stamp_ns = time_type == 3 ? UtcStamp(payload, 10) : Stamp(Get<std::uint64_t>(payload, 10));
  packet.clock = time_type == 0 ? LivoxClock::kPowerOn : LivoxClock::kSynchronised;
  constexpr std::uint8_t kSurelyNoise = 1;
  ReadPoints(layout, payload.substr(kHeaderBytes1), kSurelyNoise, packet);
  return packet;
}

LivoxPacket Parse2(std::string_view payload) {
  const auto rays = Get<std::uint16_t>(payload, 5);
  const Layout layout = Layout2(Get<std::uint8_t>(payload, 10), rays);
  CheckLength(payload, kHeaderBytes2 + layout.rays * RayBytes(layout));
  CheckLength(payload, Get<std::uint16_t>(payload, 1));
  const auto stated = Get<std::uint32_t>(payload, 24);
  boost::crc_32_type crc;
  crc.process_bytes(payload.data() + kCheckedFrom2, payload.size() - kCheckedFrom2);
  if (stated != 0 && stated != crc.checksum()) {
    Fail("has the checksum " + std::to_string(stated) + ", expected " +
         std::to_string(crc.checksum()) + " by its bytes");
  }
  const auto time_type = Get<std::uint8_t>(payload, 11);
  if (time_type > 2) {
    Fail("has the time type " + std::to_string(time_type) + ", expected 0, 1 or 2");
  }
  LivoxPacket packet;
  packet.counter = LivoxCounter{Get<std::uint16_t>(payload, 7), Get<std::uint8_t>(payload, 9)};
  packet.clock = time_type == 0 ? LivoxClock::kPowerOn : LivoxClock::kSynchronised;
  packet.stamp_ns = Stamp(Get<std::uint64_t>(payload, 28));
  constexpr std::int64_t kNsPerUnit = 100;
  packet.span_ns = Get<std::uint16_t>(payload, 3) * kNsPerUnit;
  constexpr std::uint8_t kLowConfidence = 2;
  ReadPoints(layout, payload.substr(kHeaderBytes2), kLowConfidence, packet);
  return packet;
}

}  // namespace

LivoxPacket ParseLivoxPacket(std::string_view payload) {
  if (payload.empty()) Fail("is empty");
  const auto version = static_cast<std::uint8_t>(payload.front());
  if (version != kVersion1 && version != kVersion2) {
    Fail("begins with " + std::to_string(version) + ", expected the version 0 or 5 of point data");
  }
  const std::size_t header_bytes = version == kVersion1 ? kHeaderBytes1 : kHeaderBytes2;
  if (payload.size() < header_bytes) {
    Fail("has " + Count(payload.size(), "byte") + ", expected a header of " +
         std::to_string(header_bytes));
  }
  return version == kVersion1 ? Parse1(payload) : Parse2(payload);
}

}  // namespace unlidar
