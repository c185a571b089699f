// Where the carrier of a sensor was at each time.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Returns the rotation of a quaternion x, y, z, w of about norm 1, as of a file.
inline Eigen::Quaterniond RotationOf(const Eigen::Vector4d& xyzw) {
  return Eigen::Quaterniond(xyzw.w(), xyzw.x(), xyzw.y(), xyzw.z()).normalized();
}

// Between poses farther apart nobody knows where the carrier was.
inline constexpr TimeNs kMaxPoseGapNs = 1'000'000'000;

// Poses of a carrier, interpolated: its position linearly, its rotation about a fixed axis
// (Shoemake, SIGGRAPH 1985). Remembers the last interval, as the returns of a frame fall into few
// of them.
class PoseHistory {
 public:
  // `poses`: at least two, in order of time.
  explicit PoseHistory(std::shared_ptr<const std::vector<Pose>> poses) : poses_(std::move(poses)) {}

  // Returns the transform from the carrier to the world; empty before the first pose, after the
  // last one, and between two that are farther apart than kMaxPoseGapNs.
  std::optional<Eigen::Isometry3d> At(TimeNs time_ns) {
    const std::vector<Pose>& poses = *poses_;
    if (time_ns < begin_ns_ || time_ns > end_ns_) {
      const auto later = FirstFrom(poses, &Pose::time_ns, time_ns + 1);
      if (later == poses.begin() || time_ns > poses.back().time_ns) return std::nullopt;
      const auto at = std::min(later, poses.end() - 1);
      const Pose& from = *(at - 1);
      const Pose& to = *at;
      begin_ns_ = from.time_ns;
      end_ns_ = to.time_ns;
      rotation_ = RotationOf(from.rotation_xyzw);
      position_m_ = from.position_m;
      turn_ = Eigen::AngleAxisd(rotation_.conjugate() * RotationOf(to.rotation_xyzw));
      step_m_ = to.position_m - from.position_m;
    }
    if (end_ns_ - begin_ns_ > kMaxPoseGapNs && time_ns != begin_ns_ && time_ns != end_ns_) {
      return std::nullopt;
    }
    const double share =
        static_cast<double>(time_ns - begin_ns_) / static_cast<double>(end_ns_ - begin_ns_);
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() =
        (rotation_ * Eigen::AngleAxisd(share * turn_.angle(), turn_.axis())).toRotationMatrix();
    pose.translation() = position_m_ + share * step_m_;
    return pose;
  }

  // Identity of the carrier: histories of the same poses have the same.
  const void* carrier() const { return poses_.get(); }

 private:
  std::shared_ptr<const std::vector<Pose>> poses_;
  // Interval of the last time, relative to its first pose.
  TimeNs begin_ns_ = 0;
  TimeNs end_ns_ = -1;  // none yet
  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d position_m_ = Eigen::Vector3d::Zero();
  Eigen::AngleAxisd turn_ = Eigen::AngleAxisd::Identity();
  Eigen::Vector3d step_m_ = Eigen::Vector3d::Zero();
};

}  // namespace unlidar
