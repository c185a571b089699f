// The LiDARs that send packets to one port: whose packets are taken, and whose place it is.
#pragma once

#include <chrono>
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

// Of the names of `sensors`, those that are addresses: 192-168-1-112, 192-168-1-2-3-1.
std::set<std::string> LivoxNames(const std::map<std::string, SensorConfig>& sensors);

// One sensor: its packets, cut into frames.
struct LivoxLidar {
  LivoxLidar(std::string its_name, TimeNs frame_ns) : name(std::move(its_name)), cutter(frame_ns) {}

  std::string name;
  LivoxFrameCutter cutter;
  Datagram::Clock::time_point arrived;  // its last packet
  std::optional<std::size_t> sensor;    // of the run, from its first frame on
  std::uint64_t lost_reported = 0;
};

// Anybody may send to a port. Where `sensors` names addresses, only those are taken. Else the first
// kMaxSensors are; one more takes the place of the one that was silent for longest: for `silent`,
// or without a whole frame so far. The frames of all that are not whole yet share
// kMaxUnfinishedBytes: where there are more, the sensor with the most loses its own.
class LivoxLidars {
 public:
  using Clock = Datagram::Clock;

  LivoxLidars(std::set<std::string> allowed, TimeNs frame_ns, Clock::duration silent)
      : allowed_(std::move(allowed)), frame_ns_(frame_ns), silent_(silent) {}

  // Takes a packet of points into the frames of its LiDAR; none for accelerations. Throws
  // PacketError for any other.
  LivoxLidar* Take(const Datagram& datagram);

  // The place in the run that one has given up.
  std::optional<std::size_t> FreeSlot();

  // In the order of their addresses.
  template <class Visit>
  void ForEach(const Visit& visit) {
    for (auto& [identity, lidar] : lidars_) visit(lidar);
  }
  template <class Visit>
  void ForEach(const Visit& visit) const {
    for (const auto& [identity, lidar] : lidars_) visit(lidar);
  }

  // Packets that were taken of LiDARs whose place another has.
  std::uint64_t forgotten_packets() const { return forgotten_packets_; }

  std::size_t unfinished_bytes() const;

 private:
  // One address can be that of a hub with several of them.
  using Identity = std::tuple<std::uint32_t, std::uint8_t, std::uint8_t>;

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
