// UDP packets of Livox sensors, taken off the network as they come.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "io/arrival.hpp"
#include "io/descriptor.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// In dotted decimals; `address` in the order of the host.
std::string AddressText(std::uint32_t address);

struct LivoxEndpoint {
  std::uint32_t address = 0;  // of this computer, in the order of the host; 0: all it has
  std::uint16_t port = 0;     // 0: one that is free
};

// Reads `HOST:PORT`, HOST in dotted decimals. Throws UsageError.
LivoxEndpoint ParseLivoxEndpoint(const std::string& text);

struct Datagram {
  using Clock = std::chrono::steady_clock;

  std::uint32_t source = 0;  // address of the sender, in the order of the host
  TimeNs received_ns = 0;    // Unix time
  Clock::time_point arrived;
  std::string payload;

  Arrival arrival() const { return {received_ns, NsSinceEpoch(arrived)}; }
};

// A thread of its own takes the packets: while a frame is worked off, the system would keep but a
// few. What waits here is bounded; beyond that the system drops what comes, which the counters of
// the sensors tell.
class LivoxReceiver {
 public:
  // Throws InputError where the address is not of this computer or the port is taken.
  explicit LivoxReceiver(LivoxEndpoint endpoint);
  ~LivoxReceiver();
  LivoxReceiver(const LivoxReceiver&) = delete;
  LivoxReceiver& operator=(const LivoxReceiver&) = delete;

  // Ready to read while packets wait.
  int fd() const { return waiting_.get(); }

  // The oldest that waits.
  std::optional<Datagram> Next();

  // Takes in what has arrived so far, and no more.
  void Stop();

  // ADDRESS:PORT, with the port that the system chose.
  const std::string& name() const { return name_; }

 private:
  void Bind(LivoxEndpoint endpoint);
  void Receive();
  bool IsFull() const;
  void TakeAll();

  Descriptor socket_;
  Descriptor waiting_;  // counts while datagrams_ is not empty
  Descriptor ending_;
  std::string name_;
  mutable std::mutex mutex_;
  std::deque<Datagram> datagrams_;
  std::size_t bytes_ = 0;
  std::thread thread_;
};

}  // namespace unlidar
