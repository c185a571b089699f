// Cuts the packets of one Livox sensor into frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <utility>

#include "io/arrival.hpp"
#include "io/livox_packets.hpp"
#include "io/livox_time.hpp"
#include "io/pcd.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

struct LivoxFrame {
  TimeNs stamp_ns = 0;  // start of the frame
  PcdCloud cloud;       // times in nanoseconds from the stamp
  Arrival arrival;      // of the packet of the frame that arrived last
};

// Every point packet is counted in one of the first five; `lost` ones never arrived.
struct LivoxCounts {
  std::uint64_t used = 0;
  std::uint64_t repeated = 0;      // duplicates
  std::uint64_t late = 0;          // their frame had been emitted
  std::uint64_t astray = 0;        // time far from that of the others
  std::uint64_t excess = 0;        // beyond the limits of a frame or of memory
  std::uint64_t lost = 0;          // by counters; in protocol 1 by gaps in the times
  std::uint64_t reordered = 0;     // arrived after newer ones; used unless late
  std::uint64_t noise_points = 0;  // dropped by their tags

  std::uint64_t packets() const { return used + repeated + late + astray + excess; }
};

// Frame k covers [k, k + 1) * frame_ns of LivoxTime. It is emitted once that clock has passed its
// end, with a margin for reordered packets: no single packet ends it. Its points are in order of
// time, whatever the order of the packets.
class LivoxFrameCutter {
 public:
  explicit LivoxFrameCutter(TimeNs frame_ns) : frame_ns_(frame_ns), time_(frame_ns) {}

  // Adds a packet; packets without rays are ignored.
  void Add(const LivoxPacket& packet, const Arrival& arrival);

  // Closes all open frames: no packets are expected for a while.
  void Flush();

  // Returns the next finished frame.
  std::optional<LivoxFrame> Next();

  const LivoxCounts& counts() const { return counts_; }
  const LivoxSync& sync() const { return sync_; }

  // Memory of the unfinished frames in bytes.
  std::size_t unfinished_bytes() const { return unfinished_bytes_; }

  // Drops the unfinished frames for lack of memory; counts their packets as excess.
  void DropUnfinished();

 private:
  using Order = std::pair<TimeNs, std::uint16_t>;  // stamp, counter
  struct OpenFrame {
    std::map<Order, LivoxPacket> parts;
    std::size_t points = 0;
    std::size_t bytes = 0;
    Arrival arrival;
  };

  void Restart();
  void CountBy(LivoxCounter counter);
  void CountGaps(const OpenFrame& frame, TimeNs spacing_ns);
  void CloseUntil(TimeNs time_ns);
  void Close(std::int64_t index, const OpenFrame& frame);

  TimeNs frame_ns_;
  LivoxCounts counts_;
  std::map<std::int64_t, OpenFrame> open_;  // by frame index
  std::size_t unfinished_bytes_ = 0;        // of open_
  std::optional<std::int64_t> closed_;      // last emitted frame
  std::deque<LivoxFrame> over_;

  LivoxTime time_;
  LivoxSync sync_;
  std::optional<TimeNs> last_ns_;  // time of the previous packet
  std::optional<LivoxCounter> expected_;
  std::optional<TimeNs> last_counted_ns_;  // time of the last packet without a counter
};

}  // namespace unlidar
