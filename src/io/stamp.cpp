#include "io/stamp.hpp"

#include <limits>
#include <utility>

#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "io/input_file.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr int kNsDigits = 9;

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

  std::string digits;  // without leading zeros
  int point = 0;       // the value is 0.digits * 10^point
  bool any_digit = false;
  bool fraction = false;
  std::size_t at = 0;
  for (; at < text.size(); ++at) {
    const char c = text[at];
    if (c == '.' && !fraction) {
      fraction = true;
    } else if (IsDigit(c)) {
      any_digit = true;
      const bool leading_zero = digits.empty() && c == '0';
      if (!leading_zero) digits.push_back(c);
      if (fraction && leading_zero) --point;
      if (!fraction && !leading_zero) ++point;
    } else {
      break;
    }
    if (at > 400) return std::nullopt;  // not a realistic number
  }
  if (!any_digit) return std::nullopt;

  bool seconds = fraction;
  if (at < text.size()) {
    if (text[at] != 'e' && text[at] != 'E') return std::nullopt;
    ++at;
    // from_chars accepts '-' but not '+'. The '+' is skipped only before a digit: "+-" is no sign.
    if (at + 1 < text.size() && text[at] == '+' && IsDigit(text[at + 1])) ++at;
    const auto exponent = ParseNumber<int>(text.substr(at));
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
