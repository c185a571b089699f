#include "format.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace unlidar {

std::string FixedText(double value, int digits) {
  if (!std::isfinite(value)) return "nan";
  std::array<char, 400> buffer{};  // the largest double has 309 digits before the point
  const auto result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value,
                                    std::chars_format::fixed, digits);
  const std::string text(buffer.data(), result.ptr);
  const bool is_zero = std::all_of(text.begin(), text.end(),
                                   [](char c) { return c == '-' || c == '0' || c == '.'; });
  return is_zero && text.front() == '-' ? text.substr(1) : text;
}

std::string ShortestText(double value) {
  std::array<char, 32> buffer{};
  const auto result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return {buffer.data(), result.ptr};
}

std::string Count(std::size_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

}  // namespace unlidar
