// Frames that wait until no frame with an earlier stamp can follow.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "io/sensor_frames.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Memory of removed frames is reused.
class WaitingFrames {
 public:
  // Limits for all sensors together: far more than LiDARs send in live.reorder_s, within the memory
  // of the service.
  static constexpr std::size_t kMaxFrames = 4096;
  static constexpr std::size_t kMaxBytes = std::size_t{192} << 20;

  bool empty() const { return num_waiting_ == 0; }

  // Returns the slot to load the next frame into; Add() queues it with its stamp in common time.
  LoadedFrame& Next();
  void Add(TimeNs time_ns);

  // Time of the earliest frame, and the frame itself, valid until the next one is loaded.
  TimeNs earliest_ns() const { return slots_.front().time_ns; }
  LoadedFrame* TakeEarliest();

  // If over the limits, removes and returns the newest frame of the sensor that holds the most.
  std::optional<LoadedFrame> TakeOverflow();

  // Removes all frames; returns them in order of time and sensor.
  std::vector<LoadedFrame> TakeAll();

 private:
  struct Slot {
    TimeNs time_ns = 0;
    std::size_t bytes = 0;
    LoadedFrame frame;
  };
  using Slots = std::vector<Slot>;

  static bool ComesLater(const Slot& a, const Slot& b) {
    return std::make_pair(a.time_ns, a.frame.info.sensor) >
           std::make_pair(b.time_ns, b.frame.info.sensor);
  }
  bool IsOverfull() const;
  Slots::iterator end() { return slots_.begin() + static_cast<std::ptrdiff_t>(num_waiting_); }
  Slots::iterator NewestOfBusiestSensor();

  // The first `num_waiting_` slots are a heap, the earliest on top; the rest are spare.
  Slots slots_;
  std::size_t num_waiting_ = 0;
  std::size_t bytes_ = 0;  // of all slots
};

}  // namespace unlidar
