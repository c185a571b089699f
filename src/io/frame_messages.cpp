#include "io/frame_messages.hpp"

#include "base/format.hpp"
#include "io/frame_directory.hpp"
#include "io/frames.hpp"
#include "io/input_limits.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::string_view kKeyword = "frame ";
constexpr const char* kExpectedLine = "expected a line 'frame NAME STAMP LENGTH'";

}  // namespace

void FrameMessageReader::Append(std::string_view bytes) {
  buffer_.erase(0, std::exchange(begin_, 0));
  buffer_.append(bytes);
}

std::optional<FrameMessage> FrameMessageReader::Next() {
  if (!header_ && !ReadHeader()) return std::nullopt;
  if (Unread().size() < header_->length) return std::nullopt;
  const MessageHeader header = *std::exchange(header_, std::nullopt);
  FrameMessage message;
  message.sensor = header.sensor;
  message.stamp_ns = header.stamp_ns;
  message.name = name_ + ": message " + std::to_string(number_) + " (" + header.sensor + " " +
                 header.stamp + ")";
  message.pcd = Unread().substr(0, header.length);
  begin_ += header.length;
  ++number_;
  return message;
}

void FrameMessageReader::Finish() const {
  const std::size_t got = Unread().size();
  if (header_) {
    Fail("ends after " + std::to_string(got) + " bytes of the PCD of " + header_->sensor + " " +
         header_->stamp + ", expected " + std::to_string(header_->length));
  }
  if (got > 0) Fail("ends within its line: " + Quoted(Unread()) + ", " + kExpectedLine);
}

// Returns false while the line is incomplete. Garbage is reported at its first byte.
bool FrameMessageReader::ReadHeader() {
  const std::string_view rest = Unread();
  if (rest.substr(0, kKeyword.size()) != kKeyword.substr(0, rest.size())) {
    Fail("begins with " + Quoted(rest.substr(0, rest.find('\n'))) + ", " + kExpectedLine);
  }
  const std::size_t end = rest.substr(0, kMaxMessageLineBytes).find('\n');
  if (end == std::string_view::npos) {
    if (rest.size() < kMaxMessageLineBytes) return false;
    Fail("begins with " + Quoted(rest) + " and no newline within " +
         std::to_string(kMaxMessageLineBytes) + " bytes, " + kExpectedLine);
  }
  header_ = ParseHeader(rest.substr(0, end));
  begin_ += end + 1;
  return true;
}

FrameMessageReader::MessageHeader FrameMessageReader::ParseHeader(std::string_view line) {
  const std::vector<std::string_view> words = Split(line, ' ');
  if (words.size() != 4) {
    Fail("has the line " + Quoted(line) + ", " + kExpectedLine + " with one space between two");
  }
  MessageHeader header;
  header.sensor = words[1];
  if (!IsSensorName(header.sensor)) {
    Fail("has the NAME " + Quoted(words[1]) + ", " + kExpectedSensorName);
  }
  header.stamp = words[2];
  const std::optional<TimeNs> stamp_ns = StampOf(header);
  if (!stamp_ns) Fail("has the STAMP " + Quoted(words[2]) + ", " + kExpectedStamp);
  header.stamp_ns = *stamp_ns;
  const auto length = ParseNumber<std::size_t>(words[3]);
  if (!length || *length > kMaxMessageBytes) {
    Fail("has the LENGTH " + Quoted(words[3]) + ", expected a number of bytes up to " +
         std::to_string(kMaxMessageBytes));
  }
  header.length = *length;
  return header;
}

std::optional<TimeNs> FrameMessageReader::StampOf(const MessageHeader& header) {
  const auto known =
      clocks_.try_emplace(header.sensor, name_ + ": " + header.sensor, rate_hz_(header.sensor))
          .first;
  FrameClock& clock = known->second;
  const bool was_settled = clock.is_settled();
  const std::optional<TimeNs> stamp_ns = clock.TimeOf(header.stamp);
  if (!was_settled && clock.warning()) warnings_.push_back(*clock.warning());
  return stamp_ns;
}

void FrameMessageReader::Fail(const std::string& what) const {
  throw InputError(name_ + ": message " + std::to_string(number_) + " " + what);
}

}  // namespace unlidar
