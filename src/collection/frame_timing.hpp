// Times of the returns in frames without point times, from the streaks of moving targets.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "collection/body.hpp"

namespace unlidar {

// Returns of a target in a frame without point times, assumed to last until the next frame.
struct Streak {
  double length_s = 0.0;  // of the frame
  double stamp_s = 0.0;   // stamp minus middle of the frame
  double num_returns = 0.0;
  Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();  // sum over the returns, about their mean
  Eigen::Vector3d ray_m = Eigen::Vector3d::Zero();       // to the mean
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
};

// `returns`: those of the target in one frame, as indices into the recording.
Streak StreakOf(const Recording& recording, const FrameInfo& frame,
                const Eigen::Vector3d& viewpoint_m, const std::vector<std::uint32_t>& returns,
                const Eigen::Vector3d& velocity_mps);

// Bias and common error of the times of a target's returns in the frames of one sensor. With point
// times the bias is zero, and the common error is that of the frame: none where they are given, the
// doubt of the length of a turn where their order tells them.
//
// Many recordings keep only every n-th frame of a LiDAR with about 10 frames per second; a target
// is then seen only at the beginning of the interval between two frames. The streak tells the two
// cases apart: over an interval of 0.5 s it would be as long as the distance flown.
//
// Where a scan repeats, a target is hit at nearly the same instant of each frame, and the time of
// that instant less the middle of the frame is not averaged out by any number of frames. Where it
// does not, the returns of one frame are of different times, and draw a streak as long as the way
// flown in it. The streaks of slow and fast frames tell the two apart.
class FrameTiming {
 public:
  // Adds a frame without point times.
  void Add(const Streak& streak, const BodySigmas& body);

  // Adds a frame with point times, of FrameInfo::time_sigma_s.
  void AddTimed(double sigma_s) { timed_sigma_s_ = sigma_s; }

  // Expected time of the returns after the middle of the frame, given the streaks so far. Zero at
  // the frame rate of a LiDAR: intervals of up to kLongestFrameS are a normal frame.
  double TimeBiasS() const { return time_bias_s_ * ShortProbability(); }

  // Variance of the common error; over longer intervals that of the bias.
  double VarianceS2() const;

 private:
  double ShortProbability() const { return 1.0 / (1.0 + std::exp(-log_short_)); }

  static constexpr std::size_t kNumWidths = 12;

  double timed_sigma_s_ = 0.0;  // of frames with point times
  double log_short_ = 0.0;      // log likelihood ratio: frame lasts one revolution
  double time_bias_s_ = 0.0;    // in that case
  double length_s_ = 0.0;       // of the last normal frame
  // Log likelihoods by the width of the body along the way of flight, which is not known.
  std::array<double, kNumWidths> log_streak_{};
  std::array<double, kNumWidths> log_instant_{};
};

}  // namespace unlidar
