#include "collection/facing_side.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr double kRadiusM = 0.2;
constexpr double kFlatShare = 0.4;
const Eigen::Vector3d kRay = Eigen::Vector3d::UnitX();

Eigen::Vector3d BallReturn(Random* random) {
  return random->OnFacingSide(kRadiusM, kRay) + random->Normal(0.02) * kRay;
}

struct Told {
  FacingShare share;
  double width_m;
  double true_share;
};

// A sensor sees frames of bodies along x, a return of which `draw` yields.
template <class Draw>
Told Tell(int num_frames, int per_frame, const Draw& draw) {
  FacingSide facing_side;
  double freedom = 0.0;
  double across2_m2 = 0.0;
  double nearer_m = 0.0;
  for (int f = 0; f < num_frames; ++f) {
    Eigen::Matrix3Xd returns(3, per_frame);
    for (int i = 0; i < per_frame; ++i) returns.col(i) = draw();
    nearer_m -= returns.row(0).mean() / num_frames;
    returns.colwise() -= returns.rowwise().mean().eval();
    FacingSums sums;
    for (int i = 0; i < per_frame; ++i) sums.Add(returns.col(i));
    facing_side.Add(sums);
    across2_m2 += sums.across2_m2;
    freedom += per_frame - 1;
  }
  const double width_m = std::sqrt(across2_m2 / freedom);
  return {facing_side.Share(width_m, kFlatShare), width_m, nearer_m / width_m};
}

TEST(FacingSide, OfABallTheCentreIsFound) {
  Random random(3);
  const Told told = Tell(60, 20, [&] { return BallReturn(&random); });
  EXPECT_NEAR(told.true_share, 4.0 / 3.0, 0.05);
  EXPECT_NEAR(told.share.mean, told.true_share, 0.05);
  EXPECT_LT(told.share.sigma, 0.45);
}

// Boxes that are seen through, from the front and over a corner: nothing is moved.
TEST(FacingSide, WhatIsSeenThroughIsNoBall) {
  for (const double yaw_rad : {0.0, 0.4, M_PI / 4.0}) {
    Random random(5);
    const Eigen::AngleAxisd turn(yaw_rad, Eigen::Vector3d::UnitZ());
    const Told told = Tell(60, 20, [&] {
      Eigen::Vector3d one_m = turn * random.InBox({-0.2, -0.2, -0.1}, {0.2, 0.2, 0.1});
      one_m.x() = std::min(one_m.x(), 0.0);  // as make_scenes.py folds the far half
      return one_m;
    });
    EXPECT_LT(told.true_share, kFlatShare + 0.05) << yaw_rad;
    EXPECT_NEAR(told.share.mean, kFlatShare, 1e-6) << yaw_rad;
    EXPECT_LT(told.share.sigma, 0.55) << yaw_rad;
  }
}

TEST(FacingSide, UntilReturnsTellABodyIsFlatAndThatIsUncertain) {
  const FacingShare untold = FacingSide().Share(0.1, kFlatShare);
  EXPECT_EQ(untold.mean, kFlatShare);
  EXPECT_NEAR(untold.sigma, 0.5, 0.01);
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    Random random(seed);
    const Told told = Tell(3, 2, [&] { return BallReturn(&random); });
    EXPECT_LT(told.share.mean, 1.0) << seed;
    EXPECT_GT(told.share.sigma, 0.45) << seed;
  }
}

}  // namespace
}  // namespace unlidar
