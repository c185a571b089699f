// How long frames last whose returns carry no times, by what moves in them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "collection/body.hpp"

namespace unlidar {

// The returns of a target in a frame without times, taken to last until the next one comes.
struct Streak {
  double length_s = 0.0;  // of the frame
  double stamp_s = 0.0;   // its stamp comes so long after its middle
  double num_returns = 0.0;
  Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();  // sum over the returns, about their mean
  Eigen::Vector3d ray_m = Eigen::Vector3d::Zero();       // to the mean
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
};

// Many recordings hold every so many-th frame of a LiDAR that gives ten or so a second, and then a
// target is seen at the beginning of the time between two frames alone. What tells is the streak
// that it draws: over half a second it would be as long as its way.
class FrameLength {
 public:
  // Whether a streak tells anything: frames of up to 0.2 s are what LiDARs take for one.
  static bool IsAmbiguous(double length_s);

  void Add(const Streak& streak, const BodySigmas& body);

  // The returns of a target in one frame of a recording, by their indices.
  void Add(const Recording& recording, const FrameInfo& frame, const Eigen::Vector3d& viewpoint_m,
           const std::vector<std::uint32_t>& returns, const Eigen::Vector3d& velocity_mps,
           const BodySigmas& body);

  // How much later than in the middle of such frames returns were measured, as is to be expected of
  // what is known. None for frames with times, or that come as fast as a LiDAR gives them.
  double TimeBiasS() const;

 private:
  double log_short_ = 0.0;    // log likelihood ratio: frames last as long as a LiDAR's turn
  double time_bias_s_ = 0.0;  // if they do
};

}  // namespace unlidar
