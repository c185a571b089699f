#include "io/frame_messages.hpp"

#include <charconv>
#include <utility>
#include <vector>

#include "base/format.hpp"
#include "io/frame_directory.hpp"
#include "io/frames.hpp"
#include "io/input_limits.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::string_view kKeyword = "frame ";
constexpr const char* kExpectedLine = "expected a line 'frame NAME STAMP LENGTH'";

std::vector<std::string_view> Words(std::string_view line) {
  std::vector<std::string_view> words;
  while (true) {
    const std::size_t space = line.find(' ');
    words.push_back(line.substr(0, space));
    if (space == std::string_view::npos) return words;
    line.remove_prefix(space + 1);
  }
}

}  // namespace

void FrameMessageReader::Append(std::string_view bytes) {
  buffer_.erase(0, std::exchange(begin_, 0));
  buffer_.append(bytes);
}

std::optional<FrameMessage> FrameMessageReader::Next() {
  if (!head_ && !ReadHead()) return std::nullopt;
  if (Rest().size() < head_->length) return std::nullopt;
  const Head head = *std::exchange(head_, std::nullopt);
  FrameMessage message;
  message.sensor = head.sensor;
  message.stamp_ns = head.stamp_ns;
  message.name =
      name_ + ": message " + std::to_string(number_) + " (" + head.sensor + " " + head.stamp + ")";
  message.pcd = Rest().substr(0, head.length);
  begin_ += head.length;
  ++number_;
  return message;
}

void FrameMessageReader::Finish() const {
  const std::size_t got = Rest().size();
  if (head_) {
    Fail("ends after " + std::to_string(got) + " bytes of the PCD of " + head_->sensor + " " +
         head_->stamp + ", expected " + std::to_string(head_->length));
  }
  if (got > 0) Fail("ends within its line: " + Quoted(Rest()) + ", " + kExpectedLine);
}

// False as long as the line is not complete. Garbage is told at its first byte.
bool FrameMessageReader::ReadHead() {
  const std::string_view rest = Rest();
  if (rest.substr(0, kKeyword.size()) != kKeyword.substr(0, rest.size())) {
    Fail("begins with " + Quoted(rest.substr(0, rest.find('\n'))) + ", " + kExpectedLine);
  }
  const std::size_t end = rest.substr(0, kMaxMessageLineBytes).find('\n');
  if (end == std::string_view::npos) {
    if (rest.size() < kMaxMessageLineBytes) return false;
    Fail("begins with " + Quoted(rest) + " and no newline within " +
         std::to_string(kMaxMessageLineBytes) + " bytes, " + kExpectedLine);
  }
  head_ = ParseHead(rest.substr(0, end));
  begin_ += end + 1;
  return true;
}

FrameMessageReader::Head FrameMessageReader::ParseHead(std::string_view line) {
  const std::vector<std::string_view> words = Words(line);
  if (words.size() != 4) {
    Fail("has the line " + Quoted(line) + ", " + kExpectedLine + " with one space between two");
  }
  Head head;
  head.sensor = words[1];
  if (!IsSensorName(head.sensor)) {
    Fail("has the NAME " + Quoted(words[1]) + ", " + kExpectedSensorName);
  }
  head.stamp = words[2];
  const std::optional<TimeNs> stamp_ns = StampOf(head);
  if (!stamp_ns) Fail("has the STAMP " + Quoted(words[2]) + ", " + kExpectedStamp);
  head.stamp_ns = *stamp_ns;
  const std::string_view length = words[3];
  const auto [end, error] =
      std::from_chars(length.data(), length.data() + length.size(), head.length);
  if (error != std::errc() || end != length.data() + length.size() ||
      head.length > kMaxMessageBytes) {
    Fail("has the LENGTH " + Quoted(length) + ", expected a number of bytes up to " +
         std::to_string(kMaxMessageBytes));
  }
  return head;
}

std::optional<TimeNs> FrameMessageReader::StampOf(const Head& head) {
  const auto known =
      clocks_.try_emplace(head.sensor, name_ + ": " + head.sensor, rate_hz_(head.sensor)).first;
  FrameClock& clock = known->second;
  const bool was_settled = clock.is_settled();
  const std::optional<TimeNs> stamp_ns = clock.TimeOf(head.stamp);
  if (!was_settled && clock.warning()) warnings_.push_back(*clock.warning());
  return stamp_ns;
}

void FrameMessageReader::Fail(const std::string& what) const {
  throw InputError(name_ + ": message " + std::to_string(number_) + " " + what);
}

}  // namespace unlidar
