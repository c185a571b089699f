// The moments of the frames of a stream.
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/queue.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// Those of the frames of the last while, as one that each plot had would take memory of its own.
class RecentFrameTimes {
 public:
  // Of the next frame, whose number is above those of all before.
  void Add(std::uint32_t frame, const FrameTime& at);

  // Of a frame that was added and is not forgotten.
  FrameTime At(std::uint32_t frame) const;

  // Forgets the frames before.
  void Forget(std::uint32_t frame);

 private:
  struct Frame {
    std::uint32_t number = 0;
    double time_s = 0.0;
    std::uint32_t sensor = 0;
    std::size_t first_count = 0;  // number among all that ever were
    std::size_t num_sensors = 0;  // that were known by then
  };

  Queue<Frame> frames_;
  Queue<std::uint32_t> counts_;    // (frames, sensors)
  std::size_t num_forgotten_ = 0;  // counts
};

}  // namespace unlidar
