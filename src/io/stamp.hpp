// Stamps as text: file names, timestamps.csv, output times.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/recording.hpp"

namespace unlidar {

// Returns the nanoseconds per unit of an integer time of this magnitude: seconds below 1e11,
// milliseconds below 1e14, microseconds below 1e17, else nanoseconds. Unix time is unambiguous from
// 1973 (as milliseconds) to 5138 (as seconds).
std::int64_t NsPerUnitByMagnitude(double magnitude);

// Parses a stamp exactly, never through a double. A number with a point or an exponent is in
// seconds (`1706255621.614239`, `1.706255621614239e+09`), a whole number in the unit of its
// magnitude. The tenth digit after the point rounds to the nearest nanosecond. Returns empty if the
// text is not such a number or the time does not fit into 64 bits.
std::optional<TimeNs> ParseStamp(std::string_view text);

}  // namespace unlidar
