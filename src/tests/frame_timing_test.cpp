#include "collection/frame_timing.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace unlidar {
namespace {

constexpr double kFrameS = 0.1;
const double kFrameSigmaS = kFrameS / std::sqrt(12.0);

// Frames of a body that speeds up from 1 to 10 m/s, all its returns of one instant or each of its
// own.
FrameTiming TimingOf(bool is_instant, int returns, double body_m, double length_s = kFrameS) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, body_m);
  std::uniform_real_distribution<double> uniform(-0.5 * length_s, 0.5 * length_s);
  FrameTiming timing;
  constexpr int kFrames = 60;
  for (int i = 0; i < kFrames; ++i) {
    Streak streak;
    streak.length_s = length_s;
    streak.stamp_s = -0.5 * length_s;
    streak.num_returns = returns;
    streak.velocity_mps = {0.0, 1.0 + 9.0 * i / kFrames, 0.0};
    Eigen::Matrix3Xd places_m(3, returns);
    for (int k = 0; k < returns; ++k) {
      const double time_s = is_instant ? 0.4 * length_s : uniform(random);
      places_m.col(k) = Eigen::Vector3d(noise(random), noise(random), noise(random)) +
                        time_s * streak.velocity_mps;
    }
    const Eigen::Vector3d mean_m = places_m.rowwise().mean();
    places_m.colwise() -= mean_m;
    streak.scatter_m2 = places_m * places_m.transpose();
    timing.Add(streak, BodySigmas());
  }
  return timing;
}

TEST(FrameTiming, TheCommonErrorIsThatOfAFrameWhereAllReturnsOfATargetAreOfOneInstant) {
  for (const double body_m : {0.05, 0.1, 0.2}) {
    EXPECT_NEAR(std::sqrt(TimingOf(true, 20, body_m).VarianceS2()), kFrameSigmaS, 1e-4) << body_m;
    EXPECT_NEAR(std::sqrt(TimingOf(false, 20, body_m).VarianceS2()), 0.0, 1e-4) << body_m;
  }
}

TEST(FrameTiming, TheCommonErrorIsAsLikelyAsNotWhereNothingTells) {
  EXPECT_NEAR(TimingOf(true, 1, 0.1).VarianceS2(), 0.5 * kFrameSigmaS * kFrameSigmaS, 1e-9);
}

TEST(FrameTiming, WhereFramesAreFarApartItIsTheDoubtOfTheirLength) {
  // Single returns draw no streak: as long as the interval, or as that of most LiDARs, by half.
  EXPECT_NEAR(std::sqrt(TimingOf(true, 1, 0.1, 0.5).VarianceS2()),
              std::abs(TimingOf(true, 1, 0.1, 0.5).TimeBiasS()), 1e-9);
  EXPECT_NEAR(TimingOf(true, 6, 0.1, 0.5).VarianceS2(), 0.0, 1e-9);  // told by the streaks
  EXPECT_EQ(FrameTiming().VarianceS2(), 0.0);
}

TEST(FrameTiming, WhereReturnsHaveTimesItIsTheirs) {
  FrameTiming timing;
  timing.AddTimed(0.07);
  EXPECT_NEAR(std::sqrt(timing.VarianceS2()), 0.07, 1e-12);
  EXPECT_EQ(timing.TimeBiasS(), 0.0);
}

}  // namespace
}  // namespace unlidar
