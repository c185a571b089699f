// The frame times of a stream.
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {

// Recent frame times, stored once per frame to save the memory of one per plot. Their counts stand
// in one queue: a vector in each frame would be allocated whenever the queue of frames grows.
class RecentFrameTimes {
 public:
  // Adds the next frame. Frame numbers increase.
  void Add(std::uint32_t frame, const FrameTime& at) {
    frames_.push_back({frame, at.time_s, at.sensor, num_forgotten_ + counts_.size(),
                       at.frames_before.size(), at.viewpoint_m});
    for (const std::uint32_t before : at.frames_before) counts_.push_back(before);
  }

  // Returns the time of a frame that was added and is not forgotten.
  FrameTime At(std::uint32_t frame) const {
    const auto its = FirstFrom(frames_, &Frame::number, frame);
    const auto first =
        counts_.begin() + static_cast<std::ptrdiff_t>(its->first_count - num_forgotten_);
    return {its->time_s,
            {first, first + static_cast<std::ptrdiff_t>(its->num_sensors)},
            its->sensor,
            its->viewpoint_m};
  }

  // Forgets the frames before `frame`.
  void Forget(std::uint32_t frame) {
    for (; !frames_.empty() && frames_.front().number < frame; frames_.pop_front()) {
      for (std::size_t i = 0; i < frames_.front().num_sensors; ++i) counts_.pop_front();
      num_forgotten_ += frames_.front().num_sensors;
    }
  }

 private:
  struct Frame {
    std::uint32_t number = 0;
    double time_s = 0.0;
    std::uint32_t sensor = 0;
    std::size_t first_count = 0;  // number among all counts ever added
    std::size_t num_sensors = 0;  // known at that time
    Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();
  };

  Queue<Frame> frames_;
  Queue<std::uint32_t> counts_;    // (frames, sensors)
  std::size_t num_forgotten_ = 0;  // counts
};

}  // namespace unlidar
