// The packets of one Livox sensor, cut into frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "io/arrival.hpp"
#include "io/livox_packets.hpp"
#include "io/livox_time.hpp"
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

  std::uint64_t packets() const { return used + repeated + late + astray + excess; }
};

// Frames are the times [k, k + 1) * frame_ns of LivoxTime. One is given when that says that it is
// over, with some patience for packets that overtake each other: no single packet ends it. Its
// points are in the order of their times, in whatever order the packets came.
class LivoxFrameCutter {
 public:
  explicit LivoxFrameCutter(TimeNs frame_ns) : frame_ns_(frame_ns), time_(frame_ns) {}

  // Packets without rays change nothing.
  void Add(const LivoxPacket& packet, const Arrival& arrival);

  // No more is to come for a while: gives what is pending.
  void Flush();

  // The next frame that is over.
  std::optional<LivoxFrame> Next();

  const LivoxCounts& counts() const { return counts_; }

  // Memory of the frames that are not over yet.
  std::size_t unfinished_bytes() const { return unfinished_bytes_; }

  // Leaves them out: their packets are more than there is room for.
  void DropUnfinished();

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
    std::size_t bytes = 0;
  };

  std::int64_t NextFrame() const;
  void Restart();
  void CountBy(LivoxCounter counter);
  void CountGaps(const OpenFrame& frame, TimeNs spacing_ns);
  void CloseUntil(TimeNs time_ns);
  void Close(std::int64_t index, const OpenFrame& frame);

  TimeNs frame_ns_;
  LivoxCounts counts_;
  std::map<std::int64_t, OpenFrame> open_;  // by the number of the frame
  std::size_t unfinished_bytes_ = 0;        // of these
  std::optional<std::int64_t> closed_;      // the last frame that was given
  std::deque<LivoxFrame> over_;

  LivoxTime time_;
  std::optional<TimeNs> last_ns_;  // of the packet before
  std::optional<LivoxCounter> expected_;
  std::optional<TimeNs> last_counted_ns_;  // of packets without a counter
};

}  // namespace unlidar
