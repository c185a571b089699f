// Limits of all external input at run time: stdin, packets, folders. No real station reaches them;
// together they keep the program within the memory limit of its service (MemoryMax in
// packaging/unlidar-track.service).
#pragma once

#include <cstddef>

namespace unlidar {

// Sensors of one run.
inline constexpr std::size_t kMaxSensors = 64;

// Length of a sensor's name: in messages, `--frames NAME=DIR`, the keys of `sensors`.
inline constexpr std::size_t kMaxSensorNameBytes = 120;

// A message of --stdin: its line, and the PCD after it.
inline constexpr std::size_t kMaxMessageLineBytes = 512;
inline constexpr std::size_t kMaxMessageBytes = std::size_t{1} << 28;

// A datagram of --livox. No point packet is larger.
inline constexpr std::size_t kMaxDatagramBytes = 2048;

// Queued datagrams: over two seconds of a Mid-360, or one second of the densest sensor.
inline constexpr std::size_t kMaxWaitingPacketBytes = std::size_t{1} << 23;

// A frame made of packets: twice the points that the densest of these sensors sends per second.
inline constexpr std::size_t kMaxFramePoints = std::size_t{1} << 20;
inline constexpr std::size_t kMaxFrameParts = std::size_t{1} << 15;

// Unfinished frames of all sensors together.
inline constexpr std::size_t kMaxUnfinishedBytes = std::size_t{96} << 20;

}  // namespace unlidar
