// The packets of one Livox sensor, cut into frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "io/livox_packets.hpp"
#include "io/pcd.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

struct LivoxFrame {
  TimeNs stamp_ns = 0;  // of its begin
  PcdCloud cloud;       // times are nanoseconds from the stamp
};

// Every packet of points is in one of the first five; `lost` never came.
struct LivoxCounts {
  std::uint64_t used = 0;
  std::uint64_t repeated = 0;      // came twice
  std::uint64_t late = 0;          // their frame had gone on
  std::uint64_t astray = 0;        // of a time far from the others
  std::uint64_t excess = 0;        // more than a frame holds
  std::uint64_t lost = 0;          // by the counters; of protocol 1 by gaps in the times
  std::uint64_t reordered = 0;     // came after newer ones, and were used if they were not late
  std::uint64_t noise_points = 0;  // left out for their tags
};

// Frames are the times [k, k + 1) * frame_ns of the clock. One is given when a packet shows that
// its time is over, with some patience for packets that overtake each other. Its points are in the
// order of their times, in whatever order the packets came.
//
// A sensor whose clock is not synchronised gets this computer's time at its first packet, and from
// there on its own. A clock that jumps is believed when several packets agree.
class LivoxFrameCutter {
 public:
  explicit LivoxFrameCutter(TimeNs frame_ns) : frame_ns_(frame_ns) {}

  // `received_ns`: by the clock of this computer. Packets without rays change nothing.
  void Add(const LivoxPacket& packet, TimeNs received_ns);

  // No more is to come for a while: gives what is pending.
  void Flush();

  // The next frame that is over.
  std::optional<LivoxFrame> Next();

  const LivoxCounts& counts() const { return counts_; }

 private:
  using Order = std::pair<TimeNs, std::uint16_t>;  // stamp, counter
  struct Part {
    std::uint32_t rays = 0;
    std::optional<std::int64_t> span_ns;
    std::vector<LivoxPoint> points;
  };
  struct OpenFrame {
    std::map<Order, Part> parts;
    std::size_t points = 0;
  };

  std::optional<TimeNs> TimeOf(const LivoxPacket& packet, TimeNs received_ns);
  TimeNs NotBefore(TimeNs received_ns) const;
  void CountBy(LivoxCounter counter);
  void CountGaps(const OpenFrame& frame, TimeNs spacing_ns);
  void CloseUntil(TimeNs time_ns);
  void Close(std::int64_t index, const OpenFrame& frame);

  TimeNs frame_ns_;
  LivoxCounts counts_;
  std::map<std::int64_t, OpenFrame> open_;  // by the number of the frame
  std::optional<std::int64_t> closed_;      // the last frame that was given
  std::deque<LivoxFrame> over_;

  std::optional<TimeNs> power_on_ns_;  // when a clock that counts from power-on was 0
  std::optional<TimeNs> newest_ns_;    // of a packet
  std::optional<TimeNs> last_astray_ns_;
  int astray_in_a_row_ = 0;
  std::optional<LivoxCounter> expected_;
  std::optional<TimeNs> last_counted_ns_;  // of packets without a counter
};

}  // namespace unlidar
