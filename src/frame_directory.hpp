// The frames of a directory and their stamps.
#pragma once

#include <string>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

struct FrameFile {
  std::string path;
  TimeNs stamp_ns = 0;
};

// No stamp is farther from 1970, nor with its sensor's time offset: sums and differences of two
// times, and of times and periods, must fit into 64 bits.
inline constexpr TimeNs kMaxStampNs = 4'000'000'000'000'000'000;  // the year 2096

// In the order of their stamps, at least one. Throws InputError.
std::vector<FrameFile> ListFrames(const std::string& directory);

}  // namespace unlidar
