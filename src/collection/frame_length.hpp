// Duration of frames without point times, from the streaks of moving targets.
#pragma once

#include <Eigen/Core>
#include <cmath>
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

// Many recordings keep only every n-th frame of a LiDAR with about 10 frames per second; a target
// is then seen only at the beginning of the interval between two frames. The streak tells the two
// cases apart: over an interval of 0.5 s it would be as long as the distance flown.
class FrameLength {
 public:
  // True if the duration is ambiguous: intervals of up to 0.2 s are a normal frame.
  static bool IsAmbiguous(double length_s) { return length_s > kLongestFrameS; }

  void Add(const Streak& streak, const BodySigmas& body);

  // Expected time of the returns after the middle of the frame, given the streaks so far. Zero for
  // frames with point times or at the frame rate of a LiDAR.
  double TimeBiasS() const { return time_bias_s_ / (1.0 + std::exp(-log_short_)); }

 private:
  double log_short_ = 0.0;    // log likelihood ratio: frame lasts one revolution
  double time_bias_s_ = 0.0;  // in that case
};

}  // namespace unlidar
