// Interpretation of the time field of a frame, see FrameReader.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <variant>

#include "io/pcd.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

enum class TimeReading { kOffset, kAbsolute, kAbsoluteByMagnitude };

// Raw time of a row: integer or floating, by the type of the field.
using RawTime = std::variant<std::int64_t, double>;

RawTime RawTimeOf(const PcdCloud& cloud, std::size_t row);

// Returns the time of a point in a given reading; empty if the value is not finite or the time is
// beyond kMaxStampNs.
std::optional<TimeNs> PointTime(const RawTime& raw, TimeReading reading, TimeNs stamp_ns);

// Vote of the returns of a sensor on the reading of their times.
class TimeReadingVote {
 public:
  void Add(const RawTime& raw, TimeNs stamp_ns);
  bool empty() const { return votes_ == decltype(votes_){}; }
  TimeReading Winner() const;  // the first if tied

 private:
  std::array<std::uint64_t, 3> votes_{};
};

}  // namespace unlidar
