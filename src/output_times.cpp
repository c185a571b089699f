#include "unlidar/output_times.hpp"

#include <algorithm>
#include <fstream>
#include <optional>
#include <utility>

#include "unlidar/error.hpp"
#include "unlidar/stamp.hpp"

namespace unlidar {
namespace {

constexpr std::int64_t kGiga = 1'000'000'000;
constexpr std::int64_t kMaxRateHz = 1'000'000;
constexpr double kMaxInstants = 1e7;
constexpr std::string_view kBlanks = " \t\r";
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

std::string_view Trim(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

// The field in a column of a comma-separated line, empty if there are fewer.
std::string_view Field(std::string_view line, std::size_t column) {
  for (; column > 0; --column) {
    const std::size_t comma = line.find(',');
    if (comma == std::string_view::npos) return {};
    line.remove_prefix(comma + 1);
  }
  return Trim(line.substr(0, line.find(',')));
}

std::optional<std::size_t> TimestampColumn(std::string_view header) {
  const auto columns = static_cast<std::size_t>(std::count(header.begin(), header.end(), ',')) + 1;
  for (std::size_t column = 0; column < columns; ++column) {
    if (Field(header, column) == "timestamp") return column;
  }
  return std::nullopt;
}

std::vector<TimeNs> RateInstants(const Rate& rate, TimeNs begin_ns, TimeNs end_ns) {
  // Unsigned: stamps at both ends of the 64 bits must not overflow.
  const std::uint64_t span_ns =
      static_cast<std::uint64_t>(end_ns) - static_cast<std::uint64_t>(begin_ns);
  const double hertz = static_cast<double>(rate.nanohertz) / static_cast<double>(kGiga);
  const double span_s = static_cast<double>(span_ns) * kSecondsPerNs;
  if (span_s * hertz > kMaxInstants) {
    throw UsageError("--rate " + std::to_string(hertz) + ": a recording of " +
                     std::to_string(span_s) + " s gives over 10 million output times, expected " +
                     "fewer");
  }
  std::vector<TimeNs> instants;
  RateClock clock(rate, begin_ns);
  for (std::uint64_t left_ns = span_ns;; clock.Step()) {
    instants.push_back(clock.now_ns());
    if (clock.StepNs() > left_ns) break;
    left_ns -= clock.StepNs();
  }
  return instants;
}

struct InstantsOf {
  const Recording& recording;

  std::vector<TimeNs> operator()(FirstSensorStamps) const {
    std::vector<TimeNs> stamps;
    for (const FrameInfo& frame : recording.frames) {
      if (frame.sensor == 0) stamps.push_back(frame.stamp_ns);
    }
    return stamps;
  }

  std::vector<TimeNs> operator()(const Rate& rate) const {
    if (recording.frames.empty()) return {};
    TimeNs begin_ns = recording.frames.front().begin_ns;
    TimeNs end_ns = recording.frames.front().end_ns;
    for (const FrameInfo& frame : recording.frames) {
      begin_ns = std::min(begin_ns, frame.begin_ns);
      end_ns = std::max(end_ns, frame.end_ns);
    }
    return RateInstants(rate, begin_ns, end_ns);
  }

  std::vector<TimeNs> operator()(const std::vector<TimeNs>& list) const { return list; }
};

}  // namespace

Rate ParseRate(std::string_view text) {
  // Hertz to nanohertz is the same exact shift by nine digits as seconds to nanoseconds.
  const std::optional<std::int64_t> nanohertz = ParseStamp(text);
  if (!nanohertz || *nanohertz <= 0 || *nanohertz > kMaxRateHz * kGiga) {
    throw UsageError("--rate '" + std::string(text) + "': expected a number of hertz above 0 to " +
                     std::to_string(kMaxRateHz));
  }
  return Rate{*nanohertz};
}

std::vector<TimeNs> ReadStampList(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || file.peek() == std::ifstream::traits_type::eof()) {
    throw InputError(path + ": empty or cannot be read, expected one stamp a line");
  }
  std::vector<TimeNs> stamps;
  std::string buffer;
  std::optional<std::size_t> column;  // of a CSV with a header
  bool first = true;
  for (int number = 1; std::getline(file, buffer); ++number) {
    std::string_view line = buffer;
    if (number == 1 && line.substr(0, kByteOrderMark.size()) == kByteOrderMark) {
      line.remove_prefix(kByteOrderMark.size());
    }
    line = Trim(line);
    if (line.empty() || line.front() == '#') continue;
    const bool could_be_header = std::exchange(first, false);
    if (could_be_header) {
      column = TimestampColumn(line);
      if (column) continue;
    }
    const std::string_view field = column ? Field(line, *column) : line;
    const std::optional<TimeNs> stamp = ParseStamp(field);
    if (!stamp) {
      throw InputError(path + ":" + std::to_string(number) + ": '" + std::string(field) +
                       "' is no stamp, expected seconds such as 1706255621.614239" +
                       (could_be_header ? " or a header with a column `timestamp`" : ""));
    }
    stamps.push_back(*stamp);
  }
  if (stamps.empty()) throw InputError(path + ": no stamp in it, expected one a line");
  std::sort(stamps.begin(), stamps.end());
  stamps.erase(std::unique(stamps.begin(), stamps.end()), stamps.end());
  return stamps;
}

std::vector<TimeNs> ResolveOutputTimes(const OutputTimes& times, const Recording& recording) {
  return std::visit(InstantsOf{recording}, times);
}

}  // namespace unlidar
