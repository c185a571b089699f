// Receives UDP packets of Livox sensors.
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
// few. The queue is bounded; beyond that the system drops packets, which the sensors' counters
// reveal.
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
  std::string name() const;

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

}  // namespace unlidar
