#include "io/frame_messages.hpp"

#include "base/format.hpp"
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
  if (!next_ && !ReadLine()) return std::nullopt;
  if (Unread().size() < length_) return std::nullopt;
  next_->pcd = Unread().substr(0, length_);
  begin_ += length_;
  ++number_;
  return std::exchange(next_, std::nullopt);
}

void FrameMessageReader::Finish() const {
  const std::size_t got = Unread().size();
  if (next_) {
    Fail("ends after " + std::to_string(got) + " bytes of the PCD of " + sensor_and_stamp_ +
         ", expected " + std::to_string(length_));
  }
  if (got > 0) Fail("ends within its line: " + Quoted(Unread()) + ", " + kExpectedLine);
}

// Returns false while the line is incomplete. Garbage is reported at its first byte.
bool FrameMessageReader::ReadLine() {
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
  ParseLine(rest.substr(0, end));
  begin_ += end + 1;
  return true;
}

void FrameMessageReader::ParseLine(std::string_view line) {
  const std::vector<std::string_view> words = Split(line, ' ');
  if (words.size() != 4) {
    Fail("has the line " + Quoted(line) + ", " + kExpectedLine + " with one space between two");
  }
  const std::string sensor(words[1]);
  if (!IsSensorName(sensor)) Fail("has the NAME " + Quoted(sensor) + ", " + kExpectedSensorName);
  FrameClock& clock =
      clocks_.try_emplace(sensor, name_ + ": " + sensor, FrameRateHz(config_, sensor))
          .first->second;
  const std::optional<TimeNs> stamp_ns = clock.TimeOf(words[2]);
  if (auto warning = clock.TakeWarning()) warnings_.push_back(std::move(*warning));
  if (!stamp_ns) Fail("has the STAMP " + Quoted(words[2]) + ", " + kExpectedStamp);
  const auto length = ParseNumber<std::size_t>(words[3]);
  if (!length || *length > kMaxMessageBytes) {
    Fail("has the LENGTH " + Quoted(words[3]) + ", expected a number of bytes up to " +
         std::to_string(kMaxMessageBytes));
  }
  length_ = *length;
  sensor_and_stamp_ = sensor + " " + std::string(words[2]);
  next_ =
      FrameMessage{sensor,
                   *stamp_ns,
                   name_ + ": message " + std::to_string(number_) + " (" + sensor_and_stamp_ + ")",
                   {}};
}

void FrameMessageReader::Fail(const std::string& what) const {
  throw InputError(name_ + ": message " + std::to_string(number_) + " " + what);
}

}  // namespace unlidar
