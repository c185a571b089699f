#include "io/stamp.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "io/input_file.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr int kNsDigits = 9;
constexpr std::size_t kMaxMantissaBytes = 401;  // more is no realistic number

// Returns round(0.digits * 10^point); digits has no leading zero.
std::optional<TimeNs> RoundedInteger(std::string digits, int point) {
  if (point < 0) return 0;
  const auto length = static_cast<std::size_t>(point);
  const bool round_up = length < digits.size() && digits[length] >= '5';
  digits.resize(length, '0');
  const std::optional<TimeNs> value = ParseNumber<TimeNs>("0" + digits);
  if (!value || (round_up && *value == std::numeric_limits<TimeNs>::max())) return std::nullopt;
  return *value + (round_up ? 1 : 0);
}

constexpr std::int64_t kNanohertzPerHz = 1'000'000'000;
constexpr std::int64_t kMaxRateHz = 1'000'000;
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

}  // namespace

std::int64_t NsPerUnitByMagnitude(double magnitude) {
  if (magnitude < 1e11) return 1'000'000'000;
  if (magnitude < 1e14) return 1'000'000;
  if (magnitude < 1e17) return 1'000;
  return 1;
}

std::optional<TimeNs> ParseStamp(std::string_view text) {
  const bool negative = !text.empty() && text.front() == '-';
  if (negative) text.remove_prefix(1);

  const std::size_t end = std::min(text.find_first_of("eE"), text.size());
  if (end > kMaxMantissaBytes) return std::nullopt;
  std::string digits(text.substr(0, end));
  std::size_t whole = digits.find('.');
  bool seconds = whole != std::string::npos;
  if (seconds) {
    digits.erase(whole, 1);
  } else {
    whole = digits.size();
  }
  if (digits.empty() || !std::all_of(digits.begin(), digits.end(), IsDigit)) return std::nullopt;
  const std::size_t zeros = std::min(digits.find_first_not_of('0'), digits.size());
  digits.erase(0, zeros);
  int point = static_cast<int>(whole) - static_cast<int>(zeros);  // of 0.digits * 10^point

  if (end < text.size()) {
    std::string_view power = text.substr(end + 1);
    // from_chars accepts '-' but not '+'. The '+' is skipped only before a digit: "+-" is no sign.
    if (power.size() > 1 && power[0] == '+' && IsDigit(power[1])) power.remove_prefix(1);
    const auto exponent = ParseNumber<int>(power);
    if (!exponent || *exponent < -1000 || *exponent > 1000) return std::nullopt;
    point += *exponent;
    seconds = true;
  }
  if (digits.empty()) return 0;
  if (point > 19) return std::nullopt;  // cannot fit, and would take long to compute

  std::optional<TimeNs> magnitude = RoundedInteger(digits, seconds ? point + kNsDigits : point);
  if (!magnitude) return std::nullopt;
  if (!seconds) {
    const std::int64_t unit_ns = NsPerUnitByMagnitude(static_cast<double>(*magnitude));
    if (*magnitude > std::numeric_limits<TimeNs>::max() / unit_ns) return std::nullopt;
    *magnitude *= unit_ns;
  }
  return negative ? -*magnitude : *magnitude;
}

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
    const std::vector<std::string_view> fields = Split(line, ',');
    const bool could_be_header = std::exchange(first, false);
    for (std::size_t i = 0; could_be_header && !column && i < fields.size(); ++i) {
      if (Trimmed(fields[i]) == "timestamp") column = i;
    }
    if (could_be_header && column) continue;
    std::string_view field = line;
    if (column) field = *column < fields.size() ? Trimmed(fields[*column]) : std::string_view();
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
  return SortedUnique(std::move(stamps));
}

}  // namespace unlidar
