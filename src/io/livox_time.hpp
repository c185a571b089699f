// The time of one Livox sensor, by the stamps of its packets.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "io/arrival.hpp"
#include "io/livox_packets.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// A clock that counts from when its sensor was switched on, as Unix time: this computer's at the
// first packet, and kept to it from there. It is turned by at most 200 ppm, which no two crystals
// are apart, where one frame ends and the next begins: a stamp means one time, whenever it comes.
class PowerOnClock {
 public:
  // The sensor's clock was 0 at this time.
  PowerOnClock(TimeNs zero_ns, const Arrival& arrival)
      : zero_ns_(zero_ns), before_ns_(zero_ns), host_ns_(arrival.unix_ns - arrival.steady_ns) {}

  // What is to be added to a stamp.
  TimeNs OffsetOf(TimeNs stamp_ns) const {
    return stamp_ns < turned_at_ns_ ? before_ns_ : zero_ns_;
  }

  // From the next frame on, nearer to `lag_ns`, by which this computer is ahead of the stamps.
  void Follow(TimeNs lag_ns, TimeNs next_frame_ns, TimeNs frame_ns);

  // Whether this computer's clock was set, so that its time is another one than that of the sensor.
  bool WasHostClockSet(TimeNs stamp_ns, const Arrival& arrival);

 private:
  TimeNs zero_ns_;
  TimeNs before_ns_;         // the same for earlier stamps than
  TimeNs turned_at_ns_ = 0;  // this one
  TimeNs host_ns_;           // this computer's clock less the one that nobody sets
};

// A sensor's time is the median of its last packets, so that neither packets that overtake each
// other nor fewer than half that are forged move it. A packet that is farther from it than a second
// is astray. As many in a row as the median is of, that go on from each other, are no accident: the
// clock was set, or the sensor switched off and on again, or it has rested.
class LivoxTime {
 public:
  static constexpr std::size_t kLastPackets = 21;
  static constexpr TimeNs kMaxStepNs = 1'000'000'000;

  struct Reading {
    TimeNs time_ns = 0;
    bool is_restart = false;  // unrelated to all before
  };

  // `frame_ns`: the times [k, k + 1) * frame_ns are a frame.
  explicit LivoxTime(TimeNs frame_ns) : frame_ns_(frame_ns) {}

  // The time of a packet with rays; empty for one that is astray. `earliest_ns`: where a clock that
  // counts from power-on begins anew, its time is no earlier.
  std::optional<Reading> Take(const LivoxPacket& packet, const Arrival& arrival,
                              TimeNs earliest_ns);

  // After the first packet.
  TimeNs now_ns() const { return now_ns_; }

 private:
  struct Taken {
    TimeNs time_ns = 0;
    TimeNs lag_ns = 0;  // of its stamp behind this computer's clock
  };

  bool IsNear(TimeNs time_ns) const;
  bool IsRunConfirmed(TimeNs time_ns);
  Reading Restart(TimeNs time_ns, TimeNs lag_ns);
  void Remember(const Taken& taken);

  TimeNs frame_ns_;
  std::optional<PowerOnClock> power_on_;
  std::deque<Taken> last_;  // those that were not astray
  TimeNs now_ns_ = 0;
  std::int64_t followed_ = 0;  // the frame of now_ns_ when power_on_ followed
  std::optional<TimeNs> last_astray_ns_;
  std::size_t astray_in_a_row_ = 0;
};

}  // namespace unlidar
