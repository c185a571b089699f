// Stamps as text: file names, timestamps.csv, output times of the command line.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "unlidar/types.hpp"

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

// True if a rate is valid: above 0, at most 1e6 Hz.
bool IsRate(const Rate& rate);

// Parses a decimal number of hertz exactly. Throws UsageError outside (0, 1e6] Hz.
Rate ParseRate(std::string_view text);

// Reads one stamp per line, or a CSV with a column `timestamp`; skips blank lines and lines that
// begin with '#'. Returns the stamps in ascending order without duplicates. Throws InputError
// naming file and line, as LineReader does. `are_whole`: set to true if all are written without a
// point or an exponent.
std::vector<TimeNs> ReadStampList(const std::string& path, bool* are_whole = nullptr);

}  // namespace unlidar
