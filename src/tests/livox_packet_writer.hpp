// Packets of Livox sensors, written as docs/livox.md says.
#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace unlidar {

template <class Number>
void Put(std::string& bytes, Number value) {
  for (std::size_t i = 0; i < sizeof(Number); ++i) {
    bytes.push_back(static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i)));
  }
}

// Bit by bit, unlike the program's.
inline std::uint32_t Crc32(const std::string& bytes) {
  std::uint32_t crc = 0xffffffff;
  for (const char byte : bytes) {
    crc ^= static_cast<std::uint8_t>(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1U) ^ ((crc & 1U) != 0 ? 0xedb88320 : 0);
  }
  return ~crc;
}

struct Header2 {
  std::uint16_t span = 4750;  // in 0.1 us
  std::uint16_t rays = 1;
  std::uint16_t counter = 0;
  std::uint8_t frame = 0;
  std::uint8_t data_type = 1;
  std::uint8_t time_type = 1;
  std::uint64_t stamp_ns = 1'700'000'000'000'000'000;
};

// A checksum of 0 is none.
inline std::string Packet2(const Header2& header, const std::string& points,
                           bool has_checksum = true) {
  std::string checked;
  Put(checked, header.stamp_ns);
  checked += points;
  std::string bytes;
  Put(bytes, std::uint8_t{0});
  Put(bytes, static_cast<std::uint16_t>(28 + checked.size()));
  Put(bytes, header.span);
  Put(bytes, header.rays);
  Put(bytes, header.counter);
  Put(bytes, header.frame);
  Put(bytes, header.data_type);
  Put(bytes, header.time_type);
  bytes.append(12, '\0');
  Put(bytes, has_checksum ? Crc32(checked) : 0U);
  return bytes + checked;
}

struct Header1 {
  std::uint8_t slot = 1;
  std::uint8_t lidar = 1;
  std::uint8_t time_type = 1;
  std::uint8_t data_type = 2;
  std::uint64_t stamp = 1'700'000'000'000'000'000;
};

inline std::string Packet1(const Header1& header, const std::string& points) {
  std::string bytes;
  Put(bytes, std::uint8_t{5});
  Put(bytes, header.slot);
  Put(bytes, header.lidar);
  bytes.append(5, '\0');
  Put(bytes, header.time_type);
  Put(bytes, header.data_type);
  Put(bytes, header.stamp);
  return bytes + points;
}

template <class Number>
std::string Cartesian(std::array<Number, 3> xyz, std::uint8_t tag = 0) {
  std::string bytes;
  for (const Number value : xyz) Put(bytes, value);
  Put(bytes, std::uint8_t{7});  // reflectivity
  Put(bytes, tag);
  return bytes;
}

inline std::string Repeated(const std::string& bytes, int times) {
  std::string all;
  for (int i = 0; i < times; ++i) all += bytes;
  return all;
}

}  // namespace unlidar
