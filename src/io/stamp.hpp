// Stamps as text: file names, timestamps.csv, output times.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/recording.hpp"

namespace unlidar {

// Nanoseconds in the unit that an integer time of this magnitude must be in: below 1e11 seconds,
// below 1e14 milliseconds, below 1e17 microseconds, else nanoseconds. Unix time is unambiguous from
// 1973 (as milliseconds) to 5138 (as seconds).
std::int64_t NsPerUnitByMagnitude(double magnitude);

// Reads a stamp exactly, never through a double. A number with a point or an exponent is seconds
// (`1706255621.614239`, `1.706255621614239e+09`), a whole number has the unit of its magnitude. The
// tenth digit behind the point rounds to the nearest nanosecond. Empty where the text is no such
// number or the time does not fit into 64 bits.
std::optional<TimeNs> ParseStamp(std::string_view text);

}  // namespace unlidar
