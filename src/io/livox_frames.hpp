// Cuts the packets of one Livox sensor into frames, by their stamps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <map>
#include <optional>
#include <utility>

#include "io/arrival.hpp"
#include "io/livox_packets.hpp"
#include "io/pcd.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Converts the time since power-on of a sensor to Unix time: set to this computer's clock at the
// first packet and slewed to follow it. Slewing is limited to 200 ppm, more than two crystals ever
// differ by, and takes place between frames, so that a stamp means one time whenever it arrives.
class PowerOnClock {
 public:
  // `zero_ns`: Unix time at which the sensor's clock was 0.
  PowerOnClock(TimeNs zero_ns, const Arrival& arrival)
      : zero_ns_(zero_ns), before_ns_(zero_ns), host_ns_(arrival.unix_ns - arrival.steady_ns) {}

  // Added to a stamp.
  TimeNs OffsetOf(TimeNs stamp_ns) const {
    return stamp_ns < turned_at_ns_ ? before_ns_ : zero_ns_;
  }

  // Slews, from the next frame on, towards `lag_ns`: this computer's clock less the stamps.
  void Follow(TimeNs lag_ns, TimeNs next_frame_ns, TimeNs frame_ns);

  // True if this computer's clock was set, so that it no longer agrees with the sensor's time.
  bool WasHostClockSet(TimeNs stamp_ns, const Arrival& arrival);

 private:
  TimeNs zero_ns_;
  TimeNs before_ns_;         // zero_ns_ for stamps before turned_at_ns_
  TimeNs turned_at_ns_ = 0;  // stamp from which zero_ns_ applies
  TimeNs host_ns_;           // this computer's clock minus its steady clock
};

// A sensor's time is the median over its last packets, which neither reordered packets nor fewer
// than half forged ones move. A packet more than a second away from it is astray. kLastPackets
// astray packets in a row that agree with each other are accepted: the clock was set, or the sensor
// was switched off and on again, or it was paused.
class LivoxTime {
 public:
  static constexpr std::size_t kLastPackets = 21;
  static constexpr TimeNs kMaxStepNs = 1'000'000'000;

  struct Reading {
    TimeNs time_ns = 0;
    bool is_restart = false;  // unrelated to all earlier readings
  };

  // `frame_ns`: frame k covers [k, k + 1) * frame_ns.
  explicit LivoxTime(TimeNs frame_ns) : frame_ns_(frame_ns) {}

  // Returns the time of a packet with rays; empty for an astray one. `earliest_ns`: lower limit of
  // the time at which a clock that counts from power-on restarts.
  std::optional<Reading> Take(const LivoxPacket& packet, const Arrival& arrival,
                              TimeNs earliest_ns);

  // Valid after the first packet.
  TimeNs now_ns() const { return now_ns_; }

 private:
  struct Taken {
    TimeNs time_ns = 0;
    TimeNs lag_ns = 0;  // this computer's clock minus its stamp
  };

  bool IsNear(TimeNs time_ns) const { return std::abs(time_ns - now_ns_) <= kMaxStepNs; }
  bool IsRunConfirmed(TimeNs time_ns);
  Reading Restart(TimeNs time_ns, TimeNs lag_ns);
  void Remember(const Taken& taken);

  TimeNs frame_ns_;
  std::optional<PowerOnClock> power_on_;
  std::deque<Taken> last_;  // last packets that were not astray
  TimeNs now_ns_ = 0;
  std::int64_t followed_ = 0;  // frame of the last update of power_on_
  std::optional<TimeNs> last_astray_ns_;
  std::size_t astray_in_a_row_ = 0;
};

enum class SyncState { kSynchronised, kLost, kUnsynchronised };  // kUnsynchronised: never was

const char* SyncStateName(SyncState state);

// A second in which most packets count from power-on ends the synchronisation, ten in a row in
// which most do not begin it: one that comes and goes is lost, and says so once in eleven seconds
// at most; a minority of packets, also of forged ones, tells nothing.
class LivoxSync {
 public:
  // Takes the clock and the time of a packet that is not astray.
  void Take(LivoxClock clock, TimeNs time_ns);

  // Empty before the first packet.
  std::optional<SyncState> state() const { return state_; }

  std::uint64_t losses() const { return losses_; }

 private:
  std::optional<SyncState> state_;
  std::uint64_t losses_ = 0;
  std::optional<TimeNs> begin_ns_;  // of the present second, and its packets so far
  std::uint64_t synchronised_ = 0;
  std::uint64_t free_ = 0;
  int synchronised_in_a_row_ = 0;  // seconds
};

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
  void Flush() {
    if (!open_.empty()) CloseUntil((open_.rbegin()->first + 1) * frame_ns_);
  }

  // Returns the next finished frame.
  std::optional<LivoxFrame> Next();

  const LivoxCounts& counts() const { return counts_; }
  const LivoxSync& sync() const { return sync_; }

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
