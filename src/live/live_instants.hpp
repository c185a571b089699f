// The output times of a stream, which grow with its frames.
#pragma once

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "trajectory/sampling.hpp"

namespace unlidar {

// Same as ResolveOutputTimes() of a recording, up to the newest frame; old times are forgotten.
// The first sensor is the first one that is not silent, so that rows continue if one is unplugged.
class LiveInstants {
 public:
  LiveInstants(OutputTimes times, TimeNs silent_ns)
      : times_(std::move(times)), silent_ns_(silent_ns) {}

  // Adds the output times up to the end of a frame, or for FirstSensorStamps its stamp, if it is of
  // the first sensor. Frames come in order of stamps.
  void Add(const FrameInfo& frame);

  // Sets the output times after `after_ns`, up to `until_ns`.
  void GetBetween(TimeNs after_ns, TimeNs until_ns, OutputInstants* instants) const;

  // Returns the stamps [begin_ns, end_ns) whose frames support the row at an output time: from
  // halfway to the previous one to halfway to the next one. The first interval begins at its output
  // time; the last one is symmetric.
  TimeInterval Around(TimeNs instant_ns) const;

  // Forgets the output times before `oldest_ns`, except the last of them.
  void Forget(TimeNs oldest_ns);

 private:
  bool IsOfFirst(const FrameInfo& frame);

  OutputTimes times_;
  TimeNs silent_ns_;
  std::optional<TimeNs> begin_ns_;  // of the stream
  std::vector<TimeNs> heard_ns_;    // (sensors) last stamps
  Queue<TimeNs> instants_ns_;
  std::optional<OutputInstants> of_rate_;  // without an end
  std::size_t next_ = 0;                   // index into a rate or a list
};

}  // namespace unlidar
