// Frames of a directory and their stamps.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/frame_clock.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

struct FrameFile {
  std::string path;
  TimeNs stamp_ns = 0;
};

// Largest distance of a stamp from 1970, with and without its sensor's time offset: sums and
// differences of two times, and of times and periods, must fit into 64 bits.
inline constexpr TimeNs kMaxStampNs = 4'000'000'000'000'000'000;  // the year 2096

inline constexpr std::string_view kFrameSuffix = ".pcd";

// File with the stamps of the frames of a directory.
inline constexpr const char* kStampFile = "timestamps.csv";

inline constexpr const char* kExpectedStamp =
    "expected seconds with a point, or a whole number of s, ms, us or ns since 1970";

// Parses a stamp within kMaxStampNs; returns empty for any other text.
std::optional<TimeNs> StampInRange(std::string_view text);

// True for names that a shell's *.pcd matches: no hidden files.
bool IsFrameName(const std::string& name);

// Returns the name of a frame without its suffix.
std::string_view StemOf(std::string_view name);

// Returns the frames in order of stamp, at least one. `clock` reads their names unless
// timestamps.csv has the stamps. Throws InputError.
std::vector<FrameFile> ListFrames(const std::string& directory, FrameClock* clock);

}  // namespace unlidar
