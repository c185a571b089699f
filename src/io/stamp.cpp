#include "io/stamp.hpp"

#include <charconv>
#include <limits>
#include <string>

namespace unlidar {
namespace {

constexpr int kNsDigits = 9;

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// Returns round(0.digits * 10^point); digits has no leading zero.
std::optional<TimeNs> RoundedInteger(std::string_view digits, int point) {
  std::uint64_t value = 0;
  for (int i = 0; i < point; ++i) {
    const std::size_t index = static_cast<std::size_t>(i);
    const std::uint64_t digit =
        index < digits.size() ? static_cast<std::uint64_t>(digits[index] - '0') : 0;
    if (value > (std::numeric_limits<std::uint64_t>::max() - digit) / 10) return std::nullopt;
    value = value * 10 + digit;
  }
  const bool round_up = point >= 0 && static_cast<std::size_t>(point) < digits.size() &&
                        digits[static_cast<std::size_t>(point)] >= '5';
  constexpr auto kLargest = static_cast<std::uint64_t>(std::numeric_limits<TimeNs>::max());
  if (value > kLargest - (round_up ? 1 : 0)) return std::nullopt;
  return static_cast<TimeNs>(value + (round_up ? 1 : 0));
}

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
    int exponent = 0;
    const char* const end = text.data() + text.size();
    const auto [parsed_to, error] = std::from_chars(text.data() + at, end, exponent);
    if (error != std::errc() || parsed_to != end) return std::nullopt;
    if (exponent < -1000 || exponent > 1000) return std::nullopt;
    point += exponent;
    seconds = true;
  }
  if (digits.empty()) return 0;
  if (point > 19) return std::nullopt;  // cannot fit, and would take long to compute

  std::optional<TimeNs> magnitude;
  if (seconds) {
    magnitude = RoundedInteger(digits, point + kNsDigits);
  } else {
    magnitude = RoundedInteger(digits, point);
    if (!magnitude) return std::nullopt;
    const std::int64_t unit_ns = NsPerUnitByMagnitude(static_cast<double>(*magnitude));
    if (*magnitude > std::numeric_limits<TimeNs>::max() / unit_ns) return std::nullopt;
    *magnitude *= unit_ns;
  }
  if (!magnitude) return std::nullopt;
  return negative ? -*magnitude : *magnitude;
}

}  // namespace unlidar
