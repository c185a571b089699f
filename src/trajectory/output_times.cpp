#include "trajectory/output_times.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/format.hpp"
#include "io/input_file.hpp"
#include "io/stamp.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::int64_t kGiga = 1'000'000'000;
constexpr std::int64_t kMaxRateHz = 1'000'000;
constexpr double kMaxInstants = 1e7;
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

// The field in a column of a comma-separated line, empty if there are fewer.
std::string_view Field(std::string_view line, std::size_t column) {
  for (; column > 0; --column) {
    const std::size_t comma = line.find(',');
    if (comma == std::string_view::npos) return {};
    line.remove_prefix(comma + 1);
  }
  return Trimmed(line.substr(0, line.find(',')));
}

std::optional<std::size_t> TimestampColumn(std::string_view header) {
  const auto columns = static_cast<std::size_t>(std::count(header.begin(), header.end(), ',')) + 1;
  for (std::size_t column = 0; column < columns; ++column) {
    if (Field(header, column) == "timestamp") return column;
  }
  return std::nullopt;
}

struct InstantsOf {
  const Recording& recording;

  OutputInstants operator()(FirstSensorStamps) const {
    std::vector<TimeNs> stamps;
    for (const FrameInfo& frame : recording.frames) {
      if (frame.sensor == 0) stamps.push_back(frame.stamp_ns);
    }
    return OutputInstants(std::move(stamps));
  }

  OutputInstants operator()(const Rate& rate) const {
    if (recording.frames.empty()) return OutputInstants();
    TimeNs begin_ns = recording.frames.front().begin_ns;
    TimeNs end_ns = recording.frames.front().end_ns;
    for (const FrameInfo& frame : recording.frames) {
      begin_ns = std::min(begin_ns, frame.begin_ns);
      end_ns = std::max(end_ns, frame.end_ns);
    }
    return OutputInstants(rate, begin_ns, end_ns);
  }

  OutputInstants operator()(const std::vector<TimeNs>& list) const { return OutputInstants(list); }
};

}  // namespace

bool IsRate(const Rate& rate) { return rate.nanohertz > 0 && rate.nanohertz <= kMaxRateHz * kGiga; }

Rate ParseRate(std::string_view text) {
  // Hertz to nanohertz is the same exact shift by nine digits as seconds to nanoseconds.
  const Rate rate{ParseStamp(text).value_or(0)};
  if (!IsRate(rate)) {
    throw UsageError("--rate " + Quoted(text) + ": expected a number of hertz above 0 to " +
                     std::to_string(kMaxRateHz));
  }
  return rate;
}

std::vector<TimeNs> ReadStampList(const std::string& path, bool* are_whole) {
  if (are_whole != nullptr) *are_whole = true;
  LineReader lines(path, {"one stamp a line"});
  std::vector<TimeNs> stamps;
  std::optional<std::size_t> column;  // of a CSV with a header
  bool first = true;
  while (lines.Next()) {
    std::string_view line = lines.line();
    if (lines.number() == 1 && line.substr(0, kByteOrderMark.size()) == kByteOrderMark) {
      line.remove_prefix(kByteOrderMark.size());
    }
    line = Trimmed(line);
    if (line.empty() || line.front() == '#') continue;
    const bool could_be_header = std::exchange(first, false);
    if (could_be_header) {
      column = TimestampColumn(line);
      if (column) continue;
    }
    const std::string_view field = column ? Field(line, *column) : line;
    const std::optional<TimeNs> stamp = ParseStamp(field);
    if (!stamp) {
      throw InputError(path + ":" + std::to_string(lines.number()) + ": " + Quoted(field) +
                       " is no stamp, expected seconds such as 1706255621.614239" +
                       (could_be_header ? " or a header with a column `timestamp`" : ""));
    }
    stamps.push_back(*stamp);
    if (are_whole != nullptr && field.find_first_of(".eE") != std::string_view::npos) {
      *are_whole = false;
    }
  }
  if (stamps.empty()) throw InputError(path + ": no stamp in it, expected one a line");
  return InOrder(std::move(stamps));
}

std::vector<TimeNs> InOrder(std::vector<TimeNs> instants) {
  std::sort(instants.begin(), instants.end());
  instants.erase(std::unique(instants.begin(), instants.end()), instants.end());
  return instants;
}

OutputInstants::OutputInstants(const Rate& rate, TimeNs begin_ns, TimeNs end_ns)
    : nanohertz_(static_cast<std::uint64_t>(rate.nanohertz)), begin_ns_(begin_ns) {
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
  // The last instant: from just below where rounding may have it, step by step.
  auto last = static_cast<std::uint64_t>(std::max(0.0, span_s * hertz - 2.0));
  while (ElapsedNs(last + 1) - ElapsedNs(last) <= span_ns - ElapsedNs(last)) ++last;
  size_ = last + 1;
}

TimeNs OutputInstants::operator[](std::size_t k) const {
  if (nanohertz_ == 0) return list_[k];
  return static_cast<TimeNs>(static_cast<std::uint64_t>(begin_ns_) + ElapsedNs(k));
}

std::size_t OutputInstants::CountBefore(TimeNs time_ns) const {
  std::size_t before = 0;
  std::size_t not_before = size_;
  while (before < not_before) {
    const std::size_t middle = before + (not_before - before) / 2;
    if ((*this)[middle] < time_ns) {
      before = middle + 1;
    } else {
      not_before = middle;
    }
  }
  return before;
}

// floor(k * 1e18 / nanohertz) for k up to some more than kMaxInstants. The remainder of the
// division, below 1e15, times k does not fit into 64 bits: times the thousands of k it does.
std::uint64_t OutputInstants::ElapsedNs(std::uint64_t k) const {
  constexpr std::uint64_t kDividend = std::uint64_t{1'000'000'000} * 1'000'000'000;
  const std::uint64_t remainder = kDividend % nanohertz_;
  const std::uint64_t thousands = k / 1000 * remainder;
  return k * (kDividend / nanohertz_) + thousands / nanohertz_ * 1000 +
         (thousands % nanohertz_ * 1000 + k % 1000 * remainder) / nanohertz_;
}

OutputInstants ResolveOutputTimes(const OutputTimes& times, const Recording& recording) {
  return std::visit(InstantsOf{recording}, times);
}

}  // namespace unlidar
