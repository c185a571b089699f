// How the names of one sensor's frames tell time: by stamps, or by numbers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

struct InputConfig;
struct SensorConfig;

// Numbers a second that the config gives for the frames of a sensor; 0 for none.
double FrameRateHz(const InputConfig& input, const SensorConfig& sensor);

// Names are numbers where all are whole and the least is below 1e8, which is no Unix time of this
// program's life (3 March 1973); or where, by their magnitude, they would be whole seconds of which
// most lie more than an hour apart (microseconds since a sensor was switched on). All other names
// are stamps, as ParseStamp() reads them; where a rate was given for them all the same and some are
// whole, a warning says that it changes nothing.
//
// Number n is the time n / rate. Without a rate in the config, it follows from the median
// difference of the numbers, and a warning says so:
//
//   1 to 19                   the number of a frame: 10 a second
//   20 to 2,000               milliseconds: 1,000 a second
//   20,000 to 2,000,000       microseconds
//   2e7 to 2e9                nanoseconds
//
// since a LiDAR takes 20 ms to 2 s for a frame. Other differences are refused.
//
// Of a stream only the first name is known when it is to be read: numbers are then those of frames,
// and where the next but one differs by 20 or more, it is refused. 0 is 0 by any reading and
// settles nothing.
class FrameClock {
 public:
  // `source`: what messages call the sensor or its folder. `rate_hz`: 0 for none given.
  FrameClock(std::string source, double rate_hz) : source_(std::move(source)), rate_hz_(rate_hz) {}

  // Settles how the names of a folder, of at least one, are read. Names that are no stamps count
  // for nothing. Throws InputError.
  void Settle(const std::vector<std::string_view>& names);

  // The time of a frame, which settles the reading unless it is settled; empty for a text that is
  // no stamp a frame may have. Throws InputError for numbers that cannot be read without a rate.
  std::optional<TimeNs> TimeOf(std::string_view name);

  // Whether names are numbers, and the time of one; empty beyond the times that a stamp may have.
  bool counts() const { return reading_ == Reading::kNumbers; }
  std::optional<TimeNs> OfNumber(double number) const;

  bool is_settled() const { return reading_ != Reading::kUnsettled; }

  // That a rate was assumed, or one that was given is not used.
  const std::optional<Warning>& warning() const { return warning_; }

 private:
  enum class Reading { kUnsettled, kStamps, kNumbers };

  void SetStamps(std::optional<std::uint64_t> whole);
  void SetNumbers(std::uint64_t step, const std::string& seen);
  void CheckSecond(std::uint64_t number);

  std::string source_;
  double rate_hz_;
  Reading reading_ = Reading::kUnsettled;
  bool is_assumed_by_one_ = false;  // of a stream: the second number is to bear it out
  std::optional<std::uint64_t> last_number_;
  std::optional<Warning> warning_;
};

}  // namespace unlidar
