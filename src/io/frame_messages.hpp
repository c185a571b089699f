// Frames in a stream of bytes: a line `frame NAME STAMP LENGTH`, then LENGTH bytes of a PCD file,
// and so on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/recording.hpp"
#include "io/frame_clock.hpp"

namespace unlidar {

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
  // Numbers a second of the frames of a sensor, as of FrameClock.
  using RateOfSensor = std::function<double(const std::string& sensor)>;

  // `name` of the stream, for messages.
  explicit FrameMessageReader(
      std::string name, RateOfSensor rate_hz = [](const std::string&) { return 0.0; })
      : name_(std::move(name)), rate_hz_(std::move(rate_hz)) {}

  void Append(std::string_view bytes);

  // The next message, empty until all of its bytes are there.
  std::optional<FrameMessage> Next();

  // What is newly in doubt about the stamps.
  std::vector<Warning> TakeWarnings() { return std::exchange(warnings_, {}); }

  // No byte will follow: throws in the middle of a message.
  void Finish() const;

 private:
  struct MessageHeader {
    std::string sensor;
    std::string stamp;  // as it was written
    TimeNs stamp_ns = 0;
    std::size_t length = 0;
  };

  std::string_view Unread() const { return {buffer_.data() + begin_, buffer_.size() - begin_}; }
  bool ReadHeader();
  MessageHeader ParseHeader(std::string_view line);
  std::optional<TimeNs> StampOf(const MessageHeader& header);
  [[noreturn]] void Fail(const std::string& what) const;

  std::string name_;
  std::string buffer_;
  std::size_t begin_ = 0;                // of what was not given yet
  std::uint64_t number_ = 1;             // of the message that begins there
  std::optional<MessageHeader> header_;  // of this message, once its line is there
  RateOfSensor rate_hz_;
  std::map<std::string, FrameClock> clocks_;  // by sensor
  std::vector<Warning> warnings_;             // not taken yet
};

}  // namespace unlidar
