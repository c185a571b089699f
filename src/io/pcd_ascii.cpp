#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "base/format.hpp"
#include "io/pcd_format.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r'; }
bool EndsToken(char c) { return IsBlank(c) || c == '\n'; }

const char* SkipBlanks(const char* at, const char* end) {
  while (at != end && IsBlank(*at)) ++at;
  return at;
}

const char* SkipToken(const char* at, const char* end) {
  while (at != end && !EndsToken(*at)) ++at;
  return at;
}

// Cases not handled by from_chars: a plus sign, and values too large or small for the type, which
// become infinite or 0 as in PCL.
template <typename Float>
bool ParseUnusual(std::string_view token, Float& value) {
  if (token.size() > 1 && token.front() == '+' && token[1] != '-') token.remove_prefix(1);
  const char* const end = token.data() + token.size();
  const auto [parsed_to, error] = std::from_chars(token.data(), end, value);
  if (parsed_to != end) return false;
  if (error == std::errc()) return true;
  if (error != std::errc::result_out_of_range) return false;
  value = static_cast<Float>(std::strtod(std::string(token).c_str(), nullptr));
  return true;
}

// Reads the value at `at` and returns its end; null if the token as a whole is not a number.
template <typename Float>
const char* ReadFloat(const char* at, const char* end, Float& value) {
  const auto [parsed_to, error] = std::from_chars(at, end, value);
  if (error == std::errc() && (parsed_to == end || EndsToken(*parsed_to))) return parsed_to;
  const char* const token_end = SkipToken(at, end);
  const std::string_view token(at, static_cast<std::size_t>(token_end - at));
  return ParseUnusual(token, value) ? token_end : nullptr;
}

const char* ReadInteger(const char* at, const char* end, std::int64_t& value) {
  const auto [parsed_to, error] = std::from_chars(at, end, value);
  if (error == std::errc() && (parsed_to == end || EndsToken(*parsed_to))) return parsed_to;
  double number = 0.0;  // some writers only write floats
  const char* const token_end = ReadFloat(at, end, number);
  if (token_end == nullptr || !(std::abs(number) < 0x1p63)) return nullptr;
  value = static_cast<std::int64_t>(number);
  return token_end;
}

const char* ReadCoordinate(const char* at, const char* end, PcdType type, float& value) {
  if (type == PcdType::kF32) return ReadFloat(at, end, value);  // rounded once, not twice
  double number = 0.0;
  at = ReadFloat(at, end, number);
  value = static_cast<float>(number);
  return at;
}

}  // namespace

PcdCloud ParsePcdAscii(std::string_view bytes, const PcdHeader& header, const std::string& name) {
  const std::string_view body = bytes.substr(header.body_begin);
  // A value takes a digit and a separator; the last one may end with the file.
  if (header.num_points > (body.size() + 1) / 2 / header.row_values) {
    throw InputError(name + ": the data has " + std::to_string(body.size()) +
                     " bytes, expected at least " +
                     std::to_string(2 * header.row_values * header.num_points - 1) + " for " +
                     std::to_string(header.num_points) + " points");
  }
  PcdCloud cloud = EmptyCloud(header);
  std::vector<std::pair<std::uint64_t, std::size_t>> wanted;  // column, and axis or kTime
  for (std::size_t axis = 0; axis < header.field_of.size(); ++axis) {
    const std::size_t field = header.field_of[axis];
    if (field != kNoField) wanted.emplace_back(header.fields[field].value_offset, axis);
  }
  std::sort(wanted.begin(), wanted.end());
  const char* at = body.data();
  const char* const end = at + body.size();
  std::size_t line = header.body_line;

  const auto fail = [&](const std::string& what) {
    throw InputError(name + ": line " + std::to_string(line) + ": " + what);
  };

  for (std::uint64_t row = 0; row < header.num_points; ++row) {
    at = SkipBlanks(at, end);
    for (; at != end && *at == '\n'; ++line) at = SkipBlanks(at + 1, end);
    if (at == end) {
      fail("the data ends after " + std::to_string(row) + " points, expected " +
           std::to_string(header.num_points));
    }
    auto next = wanted.begin();
    for (std::uint64_t column = 0; column < header.row_values; ++column) {
      at = SkipBlanks(at, end);
      if (at == end || *at == '\n') {
        fail("too few values, expected " + std::to_string(header.row_values));
      }
      if (next == wanted.end() || column != next->first) {
        at = SkipToken(at, end);
        continue;
      }
      const char* const token = at;
      const std::size_t axis = next++->second;
      const PcdField& field = header.fields[header.field_of[axis]];
      if (axis != PcdHeader::kTime) {
        at = ReadCoordinate(at, end, field.type, cloud.points_m[row].data()[axis]);
      } else if (cloud.floating_times.empty()) {
        at = ReadInteger(at, end, cloud.integer_times[row]);
      } else {
        at = ReadFloat(at, end, cloud.floating_times[row]);
      }
      if (at == nullptr) {
        const std::size_t length = static_cast<std::size_t>(SkipToken(token, end) - token);
        fail("field " + Quoted(field.name) + " is " + Quoted({token, length}) +
             ", expected a number");
      }
    }
    at = SkipBlanks(at, end);
    if (at != end && *at != '\n') {
      fail("too many values, expected " + std::to_string(header.row_values));
    }
  }
  return cloud;
}

}  // namespace unlidar
