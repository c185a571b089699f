// The frame times of a stream.
#pragma once

#include <cstdint>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// Recent frame times, stored once per frame to save the memory of one per plot.
class RecentFrameTimes {
 public:
  // Adds the next frame. Frame numbers increase. Reuses the memory of forgotten ones.
  void Add(std::uint32_t number, const FrameTime& at) {
    Frame& frame = frames_.Append();
    frame.number = number;
    frame.at = at;
  }

  // Returns the time of a frame that was added and is not forgotten, valid until the next call.
  const FrameTime& At(std::uint32_t number) const {
    return FirstFrom(frames_, &Frame::number, number)->at;
  }

  // Forgets the frames before `number`.
  void Forget(std::uint32_t number) {
    while (!frames_.empty() && frames_.front().number < number) frames_.pop_front();
  }

 private:
  struct Frame {
    std::uint32_t number = 0;
    FrameTime at;
  };

  Queue<Frame> frames_;
};

}  // namespace unlidar
