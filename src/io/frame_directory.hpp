// The frames of a directory and their stamps.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/recording.hpp"
#include "io/frame_clock.hpp"

namespace unlidar {

struct FrameFile {
  std::string path;
  TimeNs stamp_ns = 0;
};

// No stamp is farther from 1970, nor with its sensor's time offset: sums and differences of two
// times, and of times and periods, must fit into 64 bits.
inline constexpr TimeNs kMaxStampNs = 4'000'000'000'000'000'000;  // the year 2096

inline constexpr std::string_view kFrameSuffix = ".pcd";

// Lists the stamps of the frames of a directory.
inline constexpr const char* kStampFile = "timestamps.csv";

inline constexpr const char* kExpectedStamp =
    "expected seconds with a point, or a whole number of s, ms, us or ns since 1970";

// A stamp that a frame may have; empty for any other text.
std::optional<TimeNs> StampInRange(std::string_view text);

// What a shell's *.pcd matches: no hidden files.
bool IsFrameName(const std::string& name);

// Without the suffix of the name of a frame.
std::string_view StemOf(std::string_view name);

// In the order of their stamps, at least one. `clock`: reads their names, unless timestamps.csv has
// the stamps. Throws InputError.
std::vector<FrameFile> ListFrames(const std::string& directory, FrameClock* clock);

}  // namespace unlidar
