// The bounds of all that comes in from outside while the program runs: by stdin, by packets, by
// folders. None is reached by a real station; together they keep the program within the memory
// that its service is given (MemoryMax in packaging/unlidar-track.service).
#pragma once

#include <cstddef>
#include <cstdint>

namespace unlidar {

// Sensors of one run.
inline constexpr std::size_t kMaxSensors = 64;

// A sensor's name: in messages, `--frames NAME=DIR`, the keys of `sensors`.
inline constexpr std::size_t kMaxSensorNameBytes = 120;

// A message of --stdin: its line, and the PCD behind it.
inline constexpr std::size_t kMaxMessageLineBytes = 512;
inline constexpr std::size_t kMaxMessageBytes = std::size_t{1} << 28;

// A datagram of --livox. No packet of points is larger.
inline constexpr std::size_t kMaxDatagramBytes = 2048;

// Datagrams that wait: two seconds and more of a Mid-360, one of the densest sensor.
inline constexpr std::size_t kMaxWaitingPacketBytes = std::size_t{1} << 23;

// A frame that packets make: twice what the densest of these sensors sends in a second.
inline constexpr std::size_t kMaxFramePoints = std::size_t{1} << 20;
inline constexpr std::size_t kMaxFrameParts = std::size_t{1} << 15;

// All frames of all sensors that are not whole yet.
inline constexpr std::size_t kMaxUnfinishedBytes = std::size_t{96} << 20;

}  // namespace unlidar
