// The packets of a live run as a folder of captures (--record-packets).
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "io/descriptor.hpp"
#include "io/livox_receiver.hpp"

namespace unlidar {

// Returns the file header of a capture, in the classic format that tcpdump and Wireshark read:
// little-endian, times in nanoseconds, raw IP (LINKTYPE_RAW).
std::string CaptureHeader();

inline constexpr std::size_t kCaptureHeaderBytes = 24;
inline constexpr std::size_t kCaptureRecordHeaderBytes = 16;

// Appends the record of a packet that came to `receiver`, with IPv4 and UDP headers made anew: one
// that was cut off on reception has the length that it had in them.
void AppendCaptureRecord(const Datagram& datagram, const LivoxEndpoint& receiver,
                         std::string& records);

// Returns the size of the record that begins with `header`, of kCaptureRecordHeaderBytes or more.
std::size_t CaptureRecordBytes(std::string_view header);

struct CaptureLimits {
  std::uint64_t file_bytes = 0;   // of one file,
  std::uint64_t total_bytes = 0;  // of all, at least twice as many
};

// Files `packets_NUMBER_TIME.pcap` of consecutive numbers, also over several runs; others in the
// folder are left alone. The oldest ones give way. A file holds whole packets at all times, except
// where the process dies within a write: the next run cuts off what is not whole.
class CaptureFiles {
 public:
  // Makes the folder if only it is missing. Throws OutputError if no file can be written to it, or
  // another process records to it.
  CaptureFiles(std::string directory, CaptureLimits limits);

  // Appends `records` (AppendCaptureRecord()). Throws OutputError where one cannot be written;
  // those before it are, and the following calls try again.
  void Write(std::string_view records);

  // Packets written since construction.
  std::uint64_t packets() const { return packets_; }

  // Of all files that are there.
  std::uint64_t total_bytes() const { return total_bytes_; }

 private:
  struct File {
    std::uint64_t number = 0;
    std::string path;
    std::uint64_t bytes = 0;
  };

  void FindEarlierFiles();
  void CutOffPartOfRecord();
  void Append(std::string_view records, std::uint64_t packets);
  void MakeRoom(std::uint64_t bytes);
  void OpenNext();
  void RemoveLast();

  std::string directory_;
  CaptureLimits limits_;
  Descriptor lock_;
  std::deque<File> files_;  // oldest first,
  Descriptor open_;         // the last one, if it may be appended to
  std::uint64_t next_number_ = 1;
  std::uint64_t total_bytes_ = 0;
  std::uint64_t packets_ = 0;
};

struct RecordingCounts {
  std::uint64_t packets = 0;
  std::uint64_t lost_packets = 0;  // not recorded: the disk was full, or failed, or was too slow
  std::uint64_t bytes = 0;         // of all files that are there
};

// Records in a thread of its own, so that a slow disk delays no frame: once a second, or more often
// where there are many packets.
class PacketRecorder {
 public:
  // `files`, which must outlive it, is its own until Stop().
  PacketRecorder(CaptureFiles& files, const LivoxEndpoint& receiver);
  ~PacketRecorder() { Stop(); }

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
