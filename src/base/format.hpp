// Locale-independent text of numbers and of user input.
#pragma once

#include <charconv>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace unlidar {

// Same as std::isdigit(), in no locale.
inline bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// Returns the value with `digits` decimals; "nan" if it is not finite, never "-0.000".
std::string FixedText(double value, int digits);

// Returns the decimal number that the text is as a whole; empty if it is none or does not fit.
template <class Number>
std::optional<Number> ParseNumber(std::string_view text) {
  Number value{};
  const char* const end = text.data() + text.size();
  const auto [parsed_to, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || parsed_to != end) return std::nullopt;
  return value;
}

// Returns the parts of a text between the separators, which may be empty.
std::vector<std::string_view> Split(std::string_view text, char separator);

// Returns the shortest text that parses back to the same value.
std::string ShortestText(double value);

// Makes text of unknown origin safe for a message: one line, printable (other bytes become '?'),
// cut to `max_bytes` and followed by "..." if it is longer.
std::string Shortened(std::string_view text, std::size_t max_bytes = 80);

// Same as Shortened(), in single quotes.
inline std::string Quoted(std::string_view text) { return "'" + Shortened(text) + "'"; }

// Returns a count with its noun: "1 frame", "2 frames".
std::string Count(std::size_t count, const std::string& noun);

}  // namespace unlidar
