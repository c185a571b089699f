// Output times as the command line gives them: a rate, or a file of stamps.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Whether a rate is one: above 0, at most 1e6 Hz.
bool IsRate(const Rate& rate);

// A decimal number of hertz, read exactly. Throws UsageError outside (0, 1e6] Hz.
Rate ParseRate(std::string_view text);

// One stamp a line, or a CSV with a column `timestamp`; blank lines and lines that begin with '#'
// are skipped. Returns them in ascending order, each once. Throws InputError naming file and line,
// also for a line of more than 64 KiB, more than 10 million lines or 1 GiB: a pipe may be endless.
// `are_whole`: whether all are written without a point or an exponent.
std::vector<TimeNs> ReadStampList(const std::string& path, bool* are_whole = nullptr);

// Ascending, each once.
std::vector<TimeNs> InOrder(std::vector<TimeNs> instants);

}  // namespace unlidar
