// The Livox LiDARs that send packets to one port: reception, admission and sensor slots.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <tuple>
#include <utility>

#include "io/arrival.hpp"
#include "io/descriptor.hpp"
#include "io/livox_frames.hpp"
#include "io/livox_packets.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Returns the address in dotted decimals; `address` in host byte order.
std::string AddressText(std::uint32_t address);

struct LivoxEndpoint {
  std::uint32_t address = 0;  // of this computer, host byte order; 0: all of them
  std::uint16_t port = 0;     // 0: any free port
};

// Parses `HOST:PORT`, HOST in dotted decimals. Throws UsageError.
LivoxEndpoint ParseLivoxEndpoint(const std::string& text);

struct Datagram {
  using Clock = std::chrono::steady_clock;

  std::uint32_t source = 0;       // address of the sender, host byte order
  std::uint16_t source_port = 0;  // host byte order
  TimeNs received_ns = 0;         // Unix time
  Clock::time_point arrived;
  std::size_t sent_bytes = 0;  // of the packet
  std::string payload;         // its first kMaxDatagramBytes

  Arrival arrival() const { return {received_ns, NsSinceEpoch(arrived)}; }
};

// Receives packets in its own thread: while a frame is processed, the system would buffer only a
// few. The queue is bounded: beyond it the system drops packets, as the sensors' counters reveal.
class LivoxReceiver {
 public:
  // Throws InputError if the address is not of this computer or the port is in use.
  explicit LivoxReceiver(LivoxEndpoint endpoint);
  ~LivoxReceiver() { Stop(); }

  // Readable while packets are queued.
  int fd() const { return waiting_.get(); }

  // Returns the oldest queued packet.
  std::optional<Datagram> Next();

  // Queues the packets that have arrived so far and stops receiving.
  void Stop();

  // Address and port, also where the system chose it.
  const LivoxEndpoint& endpoint() const { return endpoint_; }

  // The same as ADDRESS:PORT.
  std::string name() const {
    return AddressText(endpoint_.address) + ":" + std::to_string(endpoint_.port);
  }

 private:
  void Receive();
  bool IsFull() const;
  void TakeAll();

  Descriptor socket_;
  Descriptor waiting_;  // readable while datagrams_ is not empty
  Descriptor ending_;
  LivoxEndpoint endpoint_;
  mutable std::mutex mutex_;
  std::deque<Datagram> datagrams_;
  std::size_t bytes_ = 0;
  std::thread thread_;
};

// Returns the names of `sensors` that are addresses: 192-168-1-112, 192-168-1-2-3-1.
std::set<std::string> LivoxNames(const std::map<std::string, SensorConfig>& sensors);

struct LivoxLidar {
  LivoxLidar(std::string its_name, TimeNs frame_ns) : name(std::move(its_name)), cutter(frame_ns) {}

  std::string name;
  LivoxFrameCutter cutter;
  Datagram::Clock::time_point arrived;  // arrival of its last packet
  std::optional<std::uint32_t> sensor;  // index in the run, from its first frame on
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
  std::optional<std::uint32_t> FreeSlot();

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
  std::set<std::uint32_t> free_slots_;
  std::uint64_t forgotten_packets_ = 0;
};

}  // namespace unlidar
