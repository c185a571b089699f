// What the time field of a frame means, see ReadRecording().
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "base/recording.hpp"
#include "io/pcd.hpp"

namespace unlidar {

enum class TimeReading { kOffset, kAbsolute, kAbsoluteByMagnitude };

// The raw time of a row: a whole number or a floating one, as the field's type says.
struct RawTime {
  PcdTimeKind kind = PcdTimeKind::kInteger;
  std::int64_t integer = 0;
  double floating = 0.0;
};

RawTime RawTimeOf(const PcdCloud& cloud, std::size_t row);

// Empty if the value is not finite or beyond kMaxStampNs.
std::optional<TimeNs> PointTime(const RawTime& raw, TimeReading reading, TimeNs stamp_ns);

// Collects the votes of the returns of a sensor.
class TimeReadingVote {
 public:
  void Add(const RawTime& raw, TimeNs stamp_ns);
  bool empty() const { return votes_ == decltype(votes_){}; }
  TimeReading Winner() const;  // the first of equals

 private:
  std::array<std::uint64_t, 3> votes_{};
};

}  // namespace unlidar
