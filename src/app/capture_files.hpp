// A folder of captured packets that keeps within a size: the files of --record-packets.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <string_view>

#include "io/descriptor.hpp"

namespace unlidar {

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

  // Appends `records` (packet_capture.hpp). Throws OutputError where one cannot be written; those
  // before it are, and the following calls try again.
  void Write(std::string_view records);

  // Packets written since construction.
  std::uint64_t packets() const { return packets_; }

  // Size of all files that are there.
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

}  // namespace unlidar
