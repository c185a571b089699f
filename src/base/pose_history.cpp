#include "base/pose_history.hpp"

#include <algorithm>

namespace unlidar {

std::optional<Eigen::Isometry3d> PoseHistory::At(TimeNs time_ns) {
  const std::vector<Pose>& poses = *poses_;
  if (time_ns < begin_ns_ || time_ns > end_ns_) {
    const auto later =
        std::upper_bound(poses.begin(), poses.end(), time_ns,
                         [](TimeNs time, const Pose& pose) { return time < pose.time_ns; });
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

}  // namespace unlidar
