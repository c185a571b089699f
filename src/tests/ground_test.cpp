#include "scene/ground.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/fitted_scene.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr double kHalf_m = 25.0;

double SlopeAt(double x, double y) { return -1.5 + 0.06 * x - 0.04 * y; }

// Returns of a sloping ground, 30 % of them of what stands on it.
std::vector<Eigen::Vector3f> SlopeUnderClutter(Random* random) {
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 8000; ++i) {
    Eigen::Vector3d p = random->InBox({-kHalf_m, -kHalf_m, 0}, {kHalf_m, kHalf_m, 0});
    p.z() = SlopeAt(p.x(), p.y()) + random->Normal(0.03);
    if (i % 10 < 3) p.z() += random->Uniform(0.0, 4.0);
    points_m.emplace_back(p.cast<float>());
  }
  return points_m;
}

// Returns of level ground at -1.5 m but for a cell-sized patch about (10, 10), which is at
// `patch_m`.
std::vector<Eigen::Vector3f> LevelButForAPatch(Random* random, double patch_m) {
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 8000; ++i) {
    Eigen::Vector3d p = random->InBox({-kHalf_m, -kHalf_m, 0}, {kHalf_m, kHalf_m, 0});
    const bool is_patch = p.x() > 8.0 && p.x() < 12.0 && p.y() > 8.0 && p.y() < 12.0;
    p.z() = (is_patch ? patch_m : -1.5) + random->Normal(0.03);
    points_m.emplace_back(p.cast<float>());
  }
  return points_m;
}

const Eigen::Vector3f kAbovePatch(10.0F, 10.0F, 4.0F);

// The lowest of a cell of 4 m lies by this much below its middle.
constexpr double kFallInHalfACell_m = 0.5 * 4.0 * (0.06 + 0.04);
constexpr double kNoise_m = 0.15;

TEST(Ground, ASlopeIsFoundUnderWhatStandsOnIt) {
  Random random(1);
  const Ground ground = GroundOf(SlopeUnderClutter(&random));
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector3d p = random.InBox({-kHalf_m, -kHalf_m, -2.0}, {kHalf_m, kHalf_m, 30.0});
    const double height_m = p.z() - SlopeAt(p.x(), p.y());
    const double found_m = ground.HeightAbove(p.cast<float>());
    EXPECT_GT(found_m, height_m - kNoise_m);
    EXPECT_LT(found_m, height_m + 2.0 * kFallInHalfACell_m + kNoise_m);
  }
}

TEST(Ground, GoesOnAsAPlaneBeyondWhatWasSeen) {
  Random random(2);
  const Ground ground = GroundOf(SlopeUnderClutter(&random));
  for (const double x : {-40.0, 0.0, 40.0}) {
    for (const double y : {-40.0, 40.0}) {
      const double found_m = ground.HeightAbove(Eigen::Vector3d(x, y, 10.0).cast<float>());
      EXPECT_GT(found_m, 10.0 - SlopeAt(x, y) - kNoise_m);
      EXPECT_LT(found_m, 10.0 - SlopeAt(x, y) + kFallInHalfACell_m + kNoise_m);
    }
  }
}

TEST(Ground, ABushOrATruckDoesNotRaiseIt) {
  for (const double top_m : {-0.5, 0.0, 1.5}) {
    Random random(3);
    const Ground ground = GroundOf(LevelButForAPatch(&random, top_m));
    EXPECT_NEAR(ground.HeightAbove(kAbovePatch), 5.5, 0.6) << top_m;
  }
}

TEST(Ground, FollowsHollowsButNoHoles) {
  Random random(4);
  const Ground hollow = GroundOf(LevelButForAPatch(&random, -2.5));
  EXPECT_NEAR(hollow.HeightAbove(kAbovePatch), 6.5, 0.15);
  // Returns far below the ground are reflections.
  const Ground hole = GroundOf(LevelButForAPatch(&random, -8.0));
  EXPECT_NEAR(hole.HeightAbove(kAbovePatch), 5.5, 0.15);
}

// Returns of level ground, and half as many images of a house 12 m high that it mirrors.
std::vector<Eigen::Vector3f> WetGroundBeforeAHouse(Random* random, double ground_m) {
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 6000; ++i) {
    Eigen::Vector3d p = random->InBox({-kHalf_m, -kHalf_m, 0}, {kHalf_m, kHalf_m, 0});
    p.z() = ground_m + random->Normal(0.03);
    points_m.emplace_back(p.cast<float>());
    if (i % 2 == 0) continue;
    const Eigen::Vector3d image_m = random->InBox({10, -20, -12}, {22, 20, 0});
    points_m.emplace_back((image_m + ground_m * Eigen::Vector3d::UnitZ()).cast<float>());
  }
  return points_m;
}

TEST(Ground, IsNotWhatIsSeenThroughNearerGround) {
  Random random(9);
  // A ray to an image meets the ground in the same cell or up to one nearer: there, images count.
  constexpr double kAtMostBelow_m = 1.5;
  for (const double ground_m : {-1.2, -1.8}) {
    const Ground ground = GroundOf(WetGroundBeforeAHouse(&random, ground_m));
    for (int i = 0; i < 100; ++i) {
      const Eigen::Vector3d p = random.InBox({-20, -20, 0}, {20, 20, 30});
      const double height_m = ground.HeightAbove(p.cast<float>());
      EXPECT_GT(height_m, p.z() - ground_m - kNoise_m) << p.transpose();
      EXPECT_LT(height_m, p.z() - ground_m + kAtMostBelow_m) << p.transpose();
    }
  }
}

// Crowns all about a mast, level with its top, and ground that is seen through their gaps.
TEST(Ground, IsSeenThroughCrowns) {
  constexpr double kCrowns_m = 12.0;
  Random random(10);
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 8000; ++i) {
    Eigen::Vector3d p = random.InBox({-kHalf_m, -kHalf_m, 0}, {kHalf_m, kHalf_m, 0});
    p.z() = p.norm() < kCrowns_m ? random.Uniform(-3.0, 3.0) : -8.0 + random.Normal(0.03);
    points_m.emplace_back(p.cast<float>());
  }
  const Ground ground = GroundOf(points_m);
  for (const float x : {-20.0F, 16.0F, 22.0F}) {
    EXPECT_NEAR(ground.HeightAbove({x, 3.0F, 0.0F}), 8.0, kNoise_m);
  }
}

// A wall all about that one beam hits, above the station, and a hollow that others see past it.
TEST(Ground, IsSeenPastWhatABeamShowsAboveTheStation) {
  Random random(11);
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 8000; ++i) {
    Eigen::Vector3d p = random.InBox({-kHalf_m, -kHalf_m, 0}, {kHalf_m, kHalf_m, 0});
    const bool is_wall = std::abs(std::max(std::abs(p.x()), std::abs(p.y())) - 10.0) < 2.0;
    const bool is_hollow = p.x() > 16.0 && p.x() < 20.0 && p.y() > 0.0 && p.y() < 4.0;
    p.z() = (is_wall ? 0.4 : (is_hollow ? -2.5 : -1.8)) + random.Normal(0.03);
    points_m.emplace_back(p.cast<float>());
  }
  const Ground ground = GroundOf(points_m);
  EXPECT_NEAR(ground.HeightAbove({18.0F, 2.0F, 0.0F}), 2.5, kNoise_m);
  EXPECT_NEAR(ground.HeightAbove({-18.0F, 2.0F, 0.0F}), 1.8, kNoise_m);
}

TEST(Ground, HoldsWhatIsNoHigherThanItIsThick) {
  Random random(7);
  const Ground ground = GroundOf(SlopeUnderClutter(&random));
  int num_held = 0;
  for (int i = 0; i < 500; ++i) {
    Eigen::Vector3d p = random.InBox({-kHalf_m, -kHalf_m, 0}, {kHalf_m, kHalf_m, 0});
    p.z() = SlopeAt(p.x(), p.y()) + random.Uniform(-1.0, 2.0);
    const bool holds = ground.IsGround(p.cast<float>());
    EXPECT_EQ(holds, ground.HeightAbove(p.cast<float>()) < kGroundThicknessM);
    num_held += holds ? 1 : 0;
  }
  // Evenly from a metre below the slope to two above it, less the fall within a cell.
  EXPECT_NEAR(num_held / 500.0, (1.0 + kGroundThicknessM) / 3.0, 0.12);
}

TEST(Ground, HoldsNothingWhereNoneIsSeen) {
  const Ground ground;
  EXPECT_FALSE(ground.IsGround({3.0F, 4.0F, -100.0F}));
}

TEST(Ground, OfASensorThatLooksUpIsInfinitelyFarBelow) {
  Random random(5);
  std::vector<Eigen::Vector3f> few;
  std::vector<Eigen::Vector3f> narrow_wall;
  std::vector<Eigen::Vector3f> crowns;  // the lower edge of the view through a wood: a cone
  for (int i = 0; i < 3000; ++i) {
    if (i < 50) few.emplace_back(random.InBox({-30, -30, 5}, {30, 30, 40}).cast<float>());
    narrow_wall.emplace_back(random.InBox({20, -7, 0}, {20.1, 7, 15}).cast<float>());
    const double range_m = random.Uniform(5.0, 30.0);
    const double azimuth = random.Uniform(-M_PI / 4, M_PI / 4);
    crowns.emplace_back(Eigen::Vector3d(range_m * std::cos(azimuth), range_m * std::sin(azimuth),
                                        range_m * random.Uniform(1.0, 1.2))
                            .cast<float>());
  }
  for (const auto& points_m : {std::vector<Eigen::Vector3f>(), few, narrow_wall, crowns}) {
    const Ground ground = GroundOf(points_m);
    EXPECT_EQ(ground.HeightAbove({3.0F, 4.0F, -100.0F}), std::numeric_limits<double>::infinity())
        << points_m.size() << " points";
  }
}

// Level crowns of trees higher than the station, and the ground at its feet with grass above it.
TEST(Ground, IsSeenFromAbove) {
  Random random(8);
  for (const double lowest_m : {-2.0, -0.1, 3.0}) {
    std::vector<Eigen::Vector3f> points_m;
    for (int i = 0; i < 8000; ++i) {
      points_m.emplace_back(
          random.InBox({-40, -40, lowest_m}, {40, 40, lowest_m + 0.5}).cast<float>());
    }
    const double height_m = GroundOf(points_m).HeightAbove({3.0F, 4.0F, 1.0F});
    if (lowest_m > 0.0) {
      EXPECT_EQ(height_m, std::numeric_limits<double>::infinity());
    } else {
      EXPECT_NEAR(height_m, 1.0 - lowest_m, kNoise_m);
    }
  }
}

// A bank 48 m wide and 3 m high, and land beside it as far as 60 m.
TEST(Ground, OfAStationOnABankIsTheBank) {
  Random random(7);
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 20000; ++i) {
    Eigen::Vector3d p = random.InBox({-60, -60, 0}, {60, 60, 0});
    p.z() = (std::abs(p.y()) < 24.0 ? -3.5 : -6.5) + random.Normal(0.03);
    points_m.emplace_back(p.cast<float>());
  }
  const Ground ground = GroundOf(points_m);
  for (const float x : {-18.0F, -5.0F, 12.0F}) {
    EXPECT_NEAR(ground.HeightAbove({x, 3.0F, -2.0F}), 1.5, kNoise_m);
  }
}

TEST(Ground, DoesNotDependOnTheOrderOfTheReturns) {
  Random random(6);
  std::vector<Eigen::Vector3f> points_m = SlopeUnderClutter(&random);
  const Ground ground = GroundOf(points_m);
  for (std::size_t i = points_m.size(); i > 1; --i) {
    std::swap(points_m[i - 1], points_m[random.Index(i)]);
  }
  const Ground shuffled = GroundOf(points_m);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3f p = random.InBox({-40, -40, -2}, {40, 40, 30}).cast<float>();
    EXPECT_EQ(ground.HeightAbove(p), shuffled.HeightAbove(p));
  }
}

}  // namespace
}  // namespace unlidar
