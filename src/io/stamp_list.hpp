// Output times from the command line: a rate, or a file of stamps.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// True if a rate is valid: above 0, at most 1e6 Hz.
bool IsRate(const Rate& rate);

// Parses a decimal number of hertz exactly. Throws UsageError outside (0, 1e6] Hz.
Rate ParseRate(std::string_view text);

// Reads one stamp per line, or a CSV with a column `timestamp`; skips blank lines and lines that
// begin with '#'. Returns the stamps in ascending order without duplicates. Throws InputError
// naming file and line, also for a line of more than 64 KiB, more than 10 million lines or 1 GiB: a
// pipe may be endless. `are_whole`: set to true if all are written without a point or an exponent.
std::vector<TimeNs> ReadStampList(const std::string& path, bool* are_whole = nullptr);

// Sorts in ascending order and removes duplicates.
std::vector<TimeNs> InOrder(std::vector<TimeNs> instants);

}  // namespace unlidar
