// The output times of a stream, which come with its frames.
#pragma once

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "trajectory/output_times.hpp"
#include "trajectory/sampling.hpp"

namespace unlidar {

// As ResolveOutputTimes() says it of a recording, up to the newest frame; old ones are forgotten.
// The first sensor is the first of those that are not silent: rows go on when one is unplugged.
class LiveInstants {
 public:
  LiveInstants(OutputTimes times, TimeNs silent_ns)
      : times_(std::move(times)), silent_ns_(silent_ns) {}

  // Adds those up to the end of a frame, of no earlier stamp than all before; of those that are
  // stamps of the first sensor, its own.
  void Add(const FrameInfo& frame);

  // Sets those after `after_ns`, up to `until_ns`.
  void GetBetween(TimeNs after_ns, TimeNs until_ns, OutputInstants* instants) const;

  // The stamps [begin_ns, end_ns) whose frames support the row at one of these instants: from
  // halfway to the one before to halfway to the one after. The first begins with itself; the last
  // reaches as far out as in.
  TimeInterval Around(TimeNs instant_ns) const;

  // Forgets those before, but for the last of them.
  void Forget(TimeNs oldest_ns);

 private:
  bool IsOfFirst(const FrameInfo& frame);
  void SkipPause(TimeNs begin_ns, double nanohertz);

  OutputTimes times_;
  TimeNs silent_ns_;
  std::optional<TimeNs> begin_ns_;  // of the stream
  std::vector<TimeNs> heard_ns_;    // by sensor: its last stamp
  Queue<TimeNs> instants_ns_;
  std::optional<OutputInstants> of_rate_;  // computed one by one, without an end
  std::size_t next_ = 0;                   // of a rate or a list
};

}  // namespace unlidar
