// LiDARs that send packets to one port: admission and sensor slots.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>

#include "io/livox_frames.hpp"
#include "io/livox_packets.hpp"
#include "io/livox_receiver.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Returns the names of `sensors` that are addresses: 192-168-1-112, 192-168-1-2-3-1.
std::set<std::string> LivoxNames(const std::map<std::string, SensorConfig>& sensors);

// One LiDAR: its packets, cut into frames.
struct LivoxLidar {
  LivoxLidar(std::string its_name, TimeNs frame_ns) : name(std::move(its_name)), cutter(frame_ns) {}

  std::string name;
  LivoxFrameCutter cutter;
  Datagram::Clock::time_point arrived;  // arrival of its last packet
  std::optional<std::size_t> sensor;    // index in the run, from its first frame on
  std::uint64_t lost_reported = 0;
};

// Anyone may send to a port. If `sensors` names addresses, only those are accepted; otherwise the
// first kMaxSensors. One more replaces the LiDAR that has been silent for longest, if silent for
// `silent` or without a whole frame so far. The unfinished frames of all LiDARs share
// kMaxUnfinishedBytes: beyond that, the one with the most loses its own.
class LivoxLidars {
 public:
  using Clock = Datagram::Clock;

  LivoxLidars(std::set<std::string> allowed, TimeNs frame_ns, Clock::duration silent)
      : allowed_(std::move(allowed)), frame_ns_(frame_ns), silent_(silent) {}

  // Adds a point packet to the frames of its LiDAR; returns null for accelerations. Throws
  // PacketError for any other packet.
  LivoxLidar* Take(const Datagram& datagram);

  // Takes a sensor index that a removed LiDAR has freed; empty if there is none.
  std::optional<std::size_t> FreeSlot();

  // Address, slot, number: one address can be that of a hub with several LiDARs.
  using Identity = std::tuple<std::uint32_t, std::uint8_t, std::uint8_t>;

  std::map<Identity, LivoxLidar>& lidars() { return lidars_; }
  const std::map<Identity, LivoxLidar>& lidars() const { return lidars_; }

  // Number of packets of LiDARs that were since removed.
  std::uint64_t forgotten_packets() const { return forgotten_packets_; }

  std::size_t unfinished_bytes() const;

 private:
  LivoxLidar& LidarOf(const Datagram& datagram, const LivoxPacket& packet);
  void MakeRoom(Clock::time_point now);
  void BoundUnfinished();

  std::set<std::string> allowed_;
  TimeNs frame_ns_;
  Clock::duration silent_;
  std::map<Identity, LivoxLidar> lidars_;
  std::set<std::size_t> free_slots_;
  std::uint64_t forgotten_packets_ = 0;
};

}  // namespace unlidar
