// Frames in a stream of bytes: a line `frame NAME STAMP LENGTH`, then LENGTH bytes of a PCD file,
// and so on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/recording.hpp"

namespace unlidar {

// No line is longer, no frame larger: a stream of garbage must not fill the memory.
inline constexpr std::size_t kMaxMessageLineBytes = 512;
inline constexpr std::size_t kMaxMessageBytes = std::size_t{1} << 28;

struct FrameMessage {
  std::string sensor;
  TimeNs stamp_ns = 0;
  std::string name;      // what messages to the user call it
  std::string_view pcd;  // holds until the next call of the reader
};

// Takes the bytes in pieces of any size. All throw InputError naming the number of the message,
// what it holds and what was expected.
class FrameMessageReader {
 public:
  // `name` of the stream, for messages.
  explicit FrameMessageReader(std::string name) : name_(std::move(name)) {}

  void Append(std::string_view bytes);

  // The next message, empty until all of its bytes are there.
  std::optional<FrameMessage> Next();

  // No byte will follow: throws in the middle of a message.
  void Finish() const;

 private:
  struct Head {
    std::string sensor;
    std::string stamp;  // as it was written
    TimeNs stamp_ns = 0;
    std::size_t length = 0;
  };

  std::string_view Rest() const { return {buffer_.data() + begin_, buffer_.size() - begin_}; }
  bool ReadHead();
  Head ParseHead(std::string_view line) const;
  [[noreturn]] void Fail(const std::string& what) const;

  std::string name_;
  std::string buffer_;
  std::size_t begin_ = 0;     // of what was not given yet
  std::uint64_t number_ = 1;  // of the message that begins there
  std::optional<Head> head_;  // of this message, once its line is there
};

}  // namespace unlidar
