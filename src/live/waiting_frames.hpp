// Frames of a stream that wait, in bounded memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/arrival.hpp"
#include "io/pcd.hpp"
#include "io/sensor_frames.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// One frame of one sensor, in the sensor's own axes and by its own clock.
struct CloudFrame {
  std::uint32_t sensor = 0;  // index into the sensors of the engine
  TimeNs stamp_ns = 0;       // of the source, before the sensor's time offset
  std::string_view name;     // for messages
  PcdCloud cloud;
  std::optional<Arrival> arrival;  // of live sources
};

// Frames that are held until their stamps are confirmed.
class HeldFrames {
 public:
  // Limits for all sensors together: about 20 MB, and more than any clock needs for confirmation.
  static constexpr std::size_t kMaxFrames = 256;
  static constexpr std::size_t kMaxPoints = std::size_t{1} << 20;

  struct Held {
    TimeNs time_ns = 0;  // the stamp, with the sensor's time offset
    std::string name;
    CloudFrame frame;
  };

  // Tells by the sensor and the time of a frame.
  using Condition = std::function<bool(std::uint32_t sensor, TimeNs time_ns)>;

  bool empty() const { return held_.empty(); }
  bool Has(std::uint32_t sensor, TimeNs time_ns) const;
  void Add(CloudFrame frame, TimeNs time_ns);

  // Takes the earliest frame for which `is_due`; returns false if there is none.
  bool TakeEarliest(const Condition& is_due, Held* taken);

  // Takes a frame to drop: one for which `should_drop`, else, if over the limits, the oldest frame
  // of the sensor that holds the most. Returns false if there is none.
  bool TakeOverflow(const Condition& should_drop, Held* taken);

 private:
  using HeldIterator = std::vector<Held>::iterator;

  bool TakeAt(HeldIterator position, Held* taken);
  HeldIterator OldestOfBusiestSensor();

  std::vector<Held> held_;  // in order of arrival
  std::size_t points_ = 0;
};

// Frames that wait until no frame with an earlier stamp can follow. Memory of removed frames is
// reused.
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
