// The instants at which rows are written.
#pragma once

#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

struct FirstSensorStamps {};
struct Rate {
  std::int64_t nanohertz = 0;
};
using OutputTimes = std::variant<FirstSensorStamps, Rate, std::vector<TimeNs>>;

// A decimal number of hertz, read exactly. Throws UsageError outside (0, 1e6] Hz.
Rate ParseRate(std::string_view text);

// One stamp a line, or a CSV with a column `timestamp`; blank lines and lines that begin with '#'
// are skipped. Returns them in ascending order, each once. Throws InputError naming file and line.
std::vector<TimeNs> ReadStampList(const std::string& path);

// The instants in ascending order. A rate runs from the first frame's begin to the last frame's
// end: begin + floor(k / rate), in integers and thus without drift. Throws UsageError for a rate
// that gives more than 10 million instants.
std::vector<TimeNs> ResolveOutputTimes(const OutputTimes& times, const Recording& recording);

}  // namespace unlidar
