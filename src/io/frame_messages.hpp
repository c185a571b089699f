// Frames in a byte stream, each as a line `frame NAME STAMP LENGTH` and LENGTH bytes of a PCD file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/frame_directory.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

struct FrameMessage {
  std::string sensor;
  TimeNs stamp_ns = 0;
  std::string name;      // for messages to the user
  std::string_view pcd;  // valid until the next call of the reader
};

// Accepts the bytes in pieces of any size. All functions throw InputError naming the number of the
// message, its content and what was expected.
class FrameMessageReader {
 public:
  // `name`: of the stream, for messages. `config` must outlive it.
  FrameMessageReader(std::string name, const Config& config)
      : name_(std::move(name)), config_(config) {}

  void Append(std::string_view bytes);

  // Returns the next message; empty until all its bytes are there.
  std::optional<FrameMessage> Next();

  // Those since the last call.
  std::vector<Warning> TakeWarnings() { return std::exchange(warnings_, {}); }

  // Checks the end of the stream; throws InputError in the middle of a message.
  void Finish() const;

 private:
  std::string_view Unread() const { return {buffer_.data() + begin_, buffer_.size() - begin_}; }
  bool ReadLine();
  void ParseLine(std::string_view line);
  [[noreturn]] void Fail(const std::string& what) const;

  std::string name_;
  std::string buffer_;
  std::size_t begin_ = 0;             // start of the unread bytes
  std::uint64_t number_ = 1;          // of the message that begins there
  std::optional<FrameMessage> next_;  // this message, once its line is complete
  std::string sensor_and_stamp_;      // of it, as written
  std::size_t length_ = 0;            // of its PCD
  const Config& config_;
  std::map<std::string, FrameClock> clocks_;  // by sensor
  std::vector<Warning> warnings_;             // not yet taken
};

}  // namespace unlidar
