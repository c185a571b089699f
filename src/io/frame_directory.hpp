// Frames of a directory and their times, from their names or a file of stamps.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "unlidar/config.hpp"
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

inline std::string_view StemOf(std::string_view name) {
  return name.substr(0, name.size() - kFrameSuffix.size());
}

// 3 March 1973: names that would be earlier Unix times are numbers.
inline constexpr std::uint64_t kMinUnixS = 100'000'000;

// Returns the entry of a sensor; the default without one.
SensorConfig SensorConfigOf(const Config& config, const std::string& name);

// Returns the configured rate of a sensor's frame names, in numbers per second; 0 if none.
double FrameRateHz(const Config& config, const std::string& name);

// Names are numbers if all are whole and the least is below kMinUnixS; or if, by their magnitude,
// they would be whole seconds that mostly lie more than an hour apart (microseconds since a sensor
// was switched on). All other names are stamps, read by ParseStamp(); if a rate is configured for
// them nevertheless and some are whole, a warning states that it is not used.
//
// Number n is the time n / rate. Without a configured rate, the rate follows from the median
// difference of the numbers, and a warning states it:
//
//   1 to 19                   frame numbers: 10 per second
//   20 to 2,000               milliseconds: 1,000 per second
//   20,000 to 2,000,000       microseconds
//   2e7 to 2e9                nanoseconds
//
// since a LiDAR takes 20 ms to 2 s for a frame. Other differences are rejected.
//
// In a stream only the first name is known when it must be read: numbers are taken for frame
// numbers, and rejected if the next differs by 20 or more. 0 is 0 in any reading: settles nothing.
class FrameClock {
 public:
  // `source`: name of the sensor or its folder in messages. `rate_hz`: 0 if none is configured.
  FrameClock(std::string source, double rate_hz) : source_(std::move(source)), rate_hz_(rate_hz) {}

  // Settles how the names of a folder, at least one, are read; ignores names that are not stamps.
  // Throws InputError.
  void Settle(const std::vector<std::string_view>& names);

  // Returns the time of a frame and settles the reading unless it is settled; empty if the text is
  // not a valid stamp of a frame. Throws InputError for numbers that cannot be read without a rate
  // and for stamps among numbers.
  std::optional<TimeNs> TimeOf(std::string_view name);

  // True if names are numbers.
  bool counts() const { return reading_ == Reading::kNumbers; }
  // Returns the time of a number; empty beyond the range of stamps.
  std::optional<TimeNs> OfNumber(double number) const;

  bool is_settled() const { return reading_ != Reading::kUnsettled; }

  // Warning that a rate was assumed, or that the configured one is not used.
  const std::optional<Warning>& warning() const { return warning_; }
  std::optional<Warning> TakeWarning() { return std::exchange(warning_, std::nullopt); }

 private:
  enum class Reading { kUnsettled, kStamps, kNumbers };

  void SetStamps(std::optional<std::uint64_t> whole);
  void SetNumbers(std::uint64_t step, const std::string& seen);

  std::string source_;
  double rate_hz_;
  Reading reading_ = Reading::kUnsettled;
  bool is_assumed_by_one_ = false;  // stream: to be confirmed by the second number
  std::optional<std::uint64_t> last_number_;
  std::optional<Warning> warning_;
};

// Returns the frames in order of stamp, at least one. `clock` reads their names unless
// timestamps.csv has the stamps. Throws InputError.
std::vector<FrameFile> ListFrames(const std::string& directory, FrameClock* clock);

}  // namespace unlidar
