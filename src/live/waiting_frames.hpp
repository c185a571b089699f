// Frames that are held back until none of an earlier stamp will come.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "io/frame_preparation.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Memory of frames that have gone is used again.
class WaitingFrames {
 public:
  // Of all sensors together: far more than LiDARs send in live.reorder_s, and within the memory of
  // the service.
  static constexpr std::size_t kMaxFrames = 4096;
  static constexpr std::size_t kMaxBytes = std::size_t{192} << 20;

  struct Dropped {
    std::uint32_t sensor = 0;
    TimeNs stamp_ns = 0;  // as of the file
  };

  bool empty() const { return num_waiting_ == 0; }

  // What the next frame is loaded into; Add() takes it, with its stamp in common time.
  LoadedFrame& Next();
  void Add(TimeNs time_ns);

  // Time of the earliest; and the frame itself, until the next one is loaded.
  TimeNs earliest_ns() const { return slots_.front().time_ns; }
  LoadedFrame* TakeEarliest();

  // Where there are too many, the newest of the sensor with the most goes.
  std::optional<Dropped> DropOverflow();

  // By time and sensor.
  std::vector<LoadedFrame> TakeAll();

 private:
  struct Slot {
    TimeNs time_ns = 0;
    std::size_t bytes = 0;
    LoadedFrame frame;

    bool ComesBefore(const Slot& other) const {
      return time_ns < other.time_ns ||
             (time_ns == other.time_ns && frame.info.sensor < other.frame.info.sensor);
    }
  };
  using SlotIterator = std::vector<Slot>::iterator;

  static bool ComesLater(const Slot& a, const Slot& b) { return b.ComesBefore(a); }
  bool IsOverfull() const;
  SlotIterator end() { return slots_.begin() + static_cast<std::ptrdiff_t>(num_waiting_); }
  SlotIterator NewestOfBusiestSensor();

  // The first `num_waiting_` are a heap, the earliest on top. Others are room for more.
  std::vector<Slot> slots_;
  std::size_t num_waiting_ = 0;
  std::size_t bytes_ = 0;  // of all slots
};

}  // namespace unlidar
