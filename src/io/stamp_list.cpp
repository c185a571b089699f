#include "io/stamp_list.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/format.hpp"
#include "io/input_file.hpp"
#include "io/stamp.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::int64_t kNanohertzPerHz = 1'000'000'000;
constexpr std::int64_t kMaxRateHz = 1'000'000;
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

// Returns a field of a comma-separated line; empty if there are fewer columns.
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

}  // namespace

bool IsRate(const Rate& rate) {
  return rate.nanohertz > 0 && rate.nanohertz <= kMaxRateHz * kNanohertzPerHz;
}

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

}  // namespace unlidar
