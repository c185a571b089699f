// Error of the times of returns without point times that is common to all frames.
#pragma once

#include <array>
#include <cstddef>

#include "collection/frame_length.hpp"

namespace unlidar {

// Where a scan repeats, a target is hit at nearly the same instant of each frame, and the time of
// that instant less the middle of the frame is not averaged out by any number of frames. Where it
// does not, the returns of one frame are of different times, and draw a streak as long as the way
// flown in it. The streaks of slow and fast frames tell the two apart.
class CommonTimeError {
 public:
  void Add(const Streak& streak);

  // Variance of the common error; zero with point times.
  double VarianceS2() const;

 private:
  static constexpr std::size_t kNumWidths = 12;

  double length_s_ = 0.0;
  // Log likelihoods by the width of the body along the way of flight, which is not known.
  std::array<double, kNumWidths> log_streak_{};
  std::array<double, kNumWidths> log_instant_{};
};

}  // namespace unlidar
