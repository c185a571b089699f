#include "base/pose_history.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace unlidar {
namespace {

constexpr TimeNs kMs = 1'000'000;

// A carrier that moves and turns about a fixed axis, each at a constant rate.
Pose SteadyPose(TimeNs time_ns) {
  const double t = static_cast<double>(time_ns) * kSecondsPerNs;
  const Eigen::Quaterniond q(Eigen::AngleAxisd(0.9 * t, Eigen::Vector3d(1, 2, -2) / 3.0));
  return {time_ns, {10.0 * t, -2.0 + t, 3.0}, {q.x(), q.y(), q.z(), q.w()}};
}

PoseHistory HistoryOf(const std::vector<Pose>& poses) {
  return PoseHistory(std::make_shared<const std::vector<Pose>>(poses));
}

TEST(PoseHistory, SteadyMotionIsExactBetweenThePoses) {
  PoseHistory poses = HistoryOf({SteadyPose(0), SteadyPose(700 * kMs), SteadyPose(800 * kMs)});
  for (const TimeNs time_ns : {0 * kMs, 13 * kMs, 790 * kMs, 350 * kMs, 700 * kMs, 800 * kMs}) {
    const auto pose = poses.At(time_ns);
    ASSERT_TRUE(pose) << time_ns;
    const Pose truth = SteadyPose(time_ns);
    const Eigen::Quaterniond q(truth.rotation_xyzw.w(), truth.rotation_xyzw.x(),
                               truth.rotation_xyzw.y(), truth.rotation_xyzw.z());
    EXPECT_LT((pose->translation() - truth.position_m).norm(), 1e-9) << time_ns;
    EXPECT_LT((pose->linear() - q.toRotationMatrix()).norm(), 1e-9) << time_ns;
  }
}

TEST(PoseHistory, TheSignOfAQuaternionMeansNothing) {
  Pose opposite = SteadyPose(500 * kMs);
  opposite.rotation_xyzw *= -1.0;
  PoseHistory poses = HistoryOf({SteadyPose(0), SteadyPose(500 * kMs)});
  PoseHistory signs = HistoryOf({SteadyPose(0), opposite});
  EXPECT_TRUE(poses.At(200 * kMs)->isApprox(*signs.At(200 * kMs), 1e-12));
}

TEST(PoseHistory, NothingIsKnownOutsideAndInALongGap) {
  PoseHistory poses =
      HistoryOf({SteadyPose(0), SteadyPose(kMaxPoseGapNs), SteadyPose(3 * kMaxPoseGapNs)});
  EXPECT_FALSE(poses.At(-1));
  EXPECT_TRUE(poses.At(kMaxPoseGapNs / 2));
  EXPECT_TRUE(poses.At(kMaxPoseGapNs));
  EXPECT_FALSE(poses.At(kMaxPoseGapNs + 1));
  EXPECT_FALSE(poses.At(2 * kMaxPoseGapNs));
  EXPECT_TRUE(poses.At(3 * kMaxPoseGapNs));
  EXPECT_FALSE(poses.At(3 * kMaxPoseGapNs + 1));
}

TEST(PoseHistory, HistoriesOfTheSamePosesAreOfOneCarrier) {
  const auto shared =
      std::make_shared<const std::vector<Pose>>(std::vector<Pose>{SteadyPose(0), SteadyPose(1)});
  EXPECT_EQ(PoseHistory(shared).carrier(), PoseHistory(shared).carrier());
  EXPECT_NE(PoseHistory(shared).carrier(), HistoryOf({SteadyPose(0), SteadyPose(1)}).carrier());
}

}  // namespace
}  // namespace unlidar
