// Processor times of frames, for the --summary of a live run.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace unlidar {

// Counts by magnitude, so that its size does not grow with the number of frames.
class ProcessingTimes {
 public:
  void Add(double seconds);

  // A time that at least this share of the frames did not exceed: the smallest one, or up to 2 %
  // more of it (1 us more below that). 0 before the first frame.
  double Quantile(double share) const;

  double max_s() const { return max_s_; }
  double sum_s() const { return sum_s_; }
  std::uint64_t frames() const { return frames_; }

 private:
  static constexpr std::size_t kSteps = 1100;  // of 2 % from 1 us: to 40 minutes

  std::array<std::uint64_t, kSteps> counts_{};
  std::uint64_t frames_ = 0;
  double max_s_ = 0.0;
  double sum_s_ = 0.0;
};

// CPU time of this thread so far, independent of the load by other programs.
double ThreadCpuSeconds();

}  // namespace unlidar
