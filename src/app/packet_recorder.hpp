// Recording of the packets of a live run, in a thread of its own: a slow disk delays no frame.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "app/capture_files.hpp"
#include "io/livox_receiver.hpp"

namespace unlidar {

struct RecordingCounts {
  std::uint64_t packets = 0;
  std::uint64_t lost_packets = 0;  // not recorded: the disk was full, or failed, or was too slow
  std::uint64_t bytes = 0;         // of all files that are there
};

// Packets are written once a second, or more often where there are many.
class PacketRecorder {
 public:
  // `files`, which must outlive it, is its own until Stop().
  PacketRecorder(CaptureFiles& files, const LivoxEndpoint& receiver);
  ~PacketRecorder() { Stop(); }
  PacketRecorder(const PacketRecorder&) = delete;
  PacketRecorder& operator=(const PacketRecorder&) = delete;

  void Add(const Datagram& datagram);

  // Writes what is pending.
  void Stop();

  RecordingCounts counts() const;

  // Why packets are lost, once for each time that it begins.
  std::optional<std::string> TakeFailure();

 private:
  // Packets beyond this are lost, as the disk is slower than they come: five seconds of a Mid-360.
  static constexpr std::size_t kMaxWaitingBytes = std::size_t{1} << 24;
  static constexpr std::size_t kMaxWriteBytes = std::size_t{1} << 20;

  void Run();
  void LosePackets(std::uint64_t count, const std::string& reason);

  CaptureFiles& files_;
  const LivoxEndpoint receiver_;
  mutable std::mutex mutex_;
  std::condition_variable is_due_;
  std::string waiting_;
  std::uint64_t waiting_packets_ = 0;
  RecordingCounts counts_;
  bool is_failing_ = false;
  std::optional<std::string> failure_;
  bool is_ending_ = false;
  std::thread thread_;
};

}  // namespace unlidar
