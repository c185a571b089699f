// Times of the returns of a frame: from its time field, see FrameReader, or from their order.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "io/pcd.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

enum class TimeReading { kOffset, kAbsolute, kAbsoluteByMagnitude };

// Raw time of a row: integer or floating, by the type of the field.
using RawTime = std::variant<std::int64_t, double>;

RawTime RawTimeOf(const PcdCloud& cloud, std::size_t row);

// Returns the time of a point in a given reading; empty if not finite or beyond kMaxStampNs.
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

// Sets the times of the returns of a LiDAR that turns, from the order of its returns: from
// `begin_ns` to `end_ns`. Returns false, and leaves the times, if the order of the returns does not
// tell. It does where the azimuth grows, or falls, through one whole turn from the first return to
// the last: such returns stand in the order in which a LiDAR that turns fires. Returns ring by ring
// pass through many turns, other scans through none or back and forth. `points_m` (N): on the
// carrier of the sensor, in the order of the file. `times_ns` (N).
bool SetTimesOfTurn(const std::vector<Eigen::Vector3f>& points_m, const SensorConfig& sensor,
                    TimeNs begin_ns, TimeNs end_ns, std::vector<TimeNs>* times_ns);

}  // namespace unlidar
