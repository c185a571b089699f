#include "scene/support.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "base/voxel_grid.hpp"
#include "tests/fitted_scene.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;
using testing::RecordingMaker;

constexpr double kGround_m = -1.5;

std::vector<Eigen::Vector3f> FlatGround() {
  RecordingMaker maker(1);
  maker.BeginFrame(0.0);
  maker.AddGround(kGround_m, 60.0, 20000);
  return maker.recording.points_m;
}

// The places of a thing, as it is seen over and over again.
std::vector<Eigen::Vector3f> Blob(const Eigen::Vector3d& centre_m) {
  Random random(2);
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 50; ++i) {
    points_m.push_back((centre_m + random.NormalVector(0.1)).cast<float>());
  }
  return points_m;
}

// Whether a blob floats above level ground with further structure.
bool BlobFloats(const Eigen::Vector3d& centre_m, const std::vector<Eigen::Vector3f>& more_m = {},
                const SupportConfig& config = SupportConfig()) {
  std::vector<Eigen::Vector3f> structure_m = FlatGround();
  const Ground ground = GroundOf(structure_m);
  const std::vector<Eigen::Vector3f> blob_m = Blob(centre_m);
  structure_m.insert(structure_m.end(), blob_m.begin(), blob_m.end());
  structure_m.insert(structure_m.end(), more_m.begin(), more_m.end());
  return SupportBy(structure_m, ground, config).IsFloating(centre_m.cast<float>());
}

std::vector<Eigen::Vector3f> Pole(double x_m, double y_m, double top_m) {
  std::vector<Eigen::Vector3f> points_m;
  for (double z = kGround_m; z <= top_m; z += 0.1) {
    points_m.push_back(Eigen::Vector3d(x_m, y_m, z).cast<float>());
  }
  return points_m;
}

TEST(Support, AThingAloneInTheAirFloats) {
  EXPECT_TRUE(BlobFloats({10, 0, 8}));
  EXPECT_TRUE(BlobFloats({0, -20, 15}));
}

TEST(Support, AThingOnAPoleOrNearStructureDoesNotFloat) {
  const Eigen::Vector3d at_m(10, 0, 8);  // the reach is 2.8 m
  EXPECT_FALSE(BlobFloats(at_m, Pole(10, 0, 7.9)));
  EXPECT_FALSE(BlobFloats(at_m, Pole(12.5, 0, 12.0)));  // what joins them may be a wire
  EXPECT_TRUE(BlobFloats(at_m, Pole(13.1, 0, 12.0)));
  EXPECT_FALSE(BlobFloats(at_m, {Eigen::Vector3f(10.0F, 2.0F, 8.0F)}));
}

TEST(Support, HeightAboveStructureIsThatOfBruteForce) {
  constexpr double kLeastM = 0.4;
  constexpr double kMostM = 2.0;
  Random random(3);
  std::vector<Eigen::Vector3f> structure_m;  // one point a voxel: all are kept
  for (double x = -6.0; x < 6.0; x += 0.75) {
    for (double y = -6.0; y < 6.0; y += 0.75) {
      for (double z = -3.0; z < 5.0; z += 1.25) {
        structure_m.push_back((Eigen::Vector3d(x, y, z) + random.NormalVector(0.05)).cast<float>());
      }
    }
  }
  const Ground ground;
  const Support support = SupportBy(structure_m, ground, SupportConfig());
  int num_found = 0;
  for (int k = 0; k < 2000; ++k) {
    const Eigen::Vector3f place_m = random.NormalVector(4.0).cast<float>();
    const double radius_m = k % 2 == 0 ? 0.3 : 0.6;
    double expected_m = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3f& point_m : structure_m) {
      const Eigen::Vector3d down_m = (place_m - point_m).cast<double>();
      if (down_m.head<2>().norm() > radius_m || down_m.z() < kLeastM || down_m.z() > kMostM)
        continue;
      expected_m = std::min(expected_m, down_m.z());
    }
    num_found += std::isfinite(expected_m) ? 1 : 0;
    const double height_m = support.HeightAboveStructureM(place_m, radius_m, kLeastM, kMostM);
    if (std::isfinite(expected_m)) {
      EXPECT_NEAR(height_m, expected_m, 1e-5);
    } else {
      EXPECT_EQ(height_m, expected_m);
    }
  }
  EXPECT_GT(num_found, 300);
  EXPECT_LT(num_found, 1700);
}

// A wall 20 m away hides what is behind it, up to the line of sight over its top.
TEST(Support, WhatIsSeenOverAnEdgeMayStandOnWhatItHides) {
  constexpr double kLeastM = 0.4;
  constexpr double kMostM = 1.2;
  constexpr double kWallM = 20.0;
  constexpr double kTopM = 2.0;
  constexpr double kCellM = 1.0;  // that directions are told apart by there
  std::vector<Eigen::Vector3f> wall_m;
  for (double x = -10.0; x < 10.0; x += 0.3) {
    for (double z = 0.0; z <= kTopM; z += 0.3) {
      wall_m.push_back(Eigen::Vector3d(x, kWallM, z).cast<float>());
    }
  }
  const auto height_m = [&](bool is_lasting, double x, double y, double above_m) {
    Support support{Ground(), SupportConfig()};
    support.Fill(wall_m, std::vector<char>(wall_m.size(), is_lasting ? 1 : 0), {});
    const Eigen::Vector3d place_m(x, y, kTopM * y / kWallM + above_m);
    return support.HeightAboveEdgeM(place_m.cast<float>(), kLeastM, kMostM);
  };
  for (const double x : {-5.0, 0.0, 3.0}) {
    for (const double y : {22.5, 24.0, 25.0}) {
      EXPECT_NEAR(height_m(true, x, y, 0.5), 0.5, kCellM) << x << " " << y;
      EXPECT_EQ(height_m(true, x, y, kMostM + kCellM), HUGE_VAL) << x << " " << y;
      EXPECT_EQ(height_m(false, x, y, 0.5), HUGE_VAL) << x << " " << y;
    }
    EXPECT_EQ(height_m(true, x, kWallM + kEdgeReachM + 2.0, 0.5), HUGE_VAL) << x;
    EXPECT_EQ(height_m(true, x, kWallM - 2.0, 0.5), HUGE_VAL) << x;
  }
  EXPECT_EQ(height_m(true, 15.0, 24.0, 0.5), HUGE_VAL);
}

// Of the structure in a voxel one point is kept, the same one in any order.
TEST(Support, DoesNotDependOnTheOrderOfTheStructure) {
  Random random(7);
  std::vector<Eigen::Vector3f> structure_m;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d middle_m = random.NormalVector(12.0);
    for (int k = 0; k < 20; ++k) {
      structure_m.push_back((middle_m + random.NormalVector(0.1)).cast<float>());
    }
  }
  const Ground ground;
  const Support support = SupportBy(structure_m, ground, SupportConfig());
  std::reverse(structure_m.begin(), structure_m.end());
  const Support reversed = SupportBy(structure_m, ground, SupportConfig());
  int num_floating = 0;
  for (int i = 0; i < 2000; ++i) {
    const auto place_m = random.NormalVector(8.0).cast<float>().eval();
    EXPECT_EQ(support.IsFloating(place_m), reversed.IsFloating(place_m)) << place_m.transpose();
    num_floating += support.IsFloating(place_m) ? 1 : 0;
  }
  EXPECT_GT(num_floating, 100);
  EXPECT_LT(num_floating, 1900);
}

// A sign whose gantry is above all that the sensor sees.
TEST(Support, AThingThatReachesToTheEdgeOfTheViewMayHangFromWhatIsBeyond) {
  const std::vector<Eigen::Vector3f> structure_m = FlatGround();
  const Ground ground = GroundOf(structure_m);
  const Eigen::Vector3f sign_m(20.0F, 0.0F, 4.0F);  // at 11 degrees, the reach is 10
  const auto floats = [&](const ElevationRange& view) {
    return SupportBy(structure_m, ground, SupportConfig(), view).IsFloating(sign_m);
  };
  EXPECT_TRUE(floats({}));
  EXPECT_FALSE(floats({-M_PI / 2, 0.22}));
  EXPECT_TRUE(floats({-M_PI / 2, 0.5}));
  EXPECT_FALSE(floats({0.18, M_PI / 2}));
}

TEST(Support, StructureOfItsOwnSizeIsTheThingItself) {
  const Eigen::Vector3d at_m(10, 0, 8);
  EXPECT_TRUE(BlobFloats(at_m, {Eigen::Vector3f(10.0F, 1.4F, 8.0F)}));
  EXPECT_FALSE(BlobFloats(at_m, {Eigen::Vector3f(10.0F, 1.6F, 8.0F)}));
}

TEST(Support, AThingLowAboveTheGroundStandsOnIt) {
  SupportConfig config;
  config.reach = {3.0, 0.0};
  EXPECT_FALSE(BlobFloats({10, 0, kGround_m + 2.8}, {}, config));
  EXPECT_TRUE(BlobFloats({10, 0, kGround_m + 3.5}, {}, config));
  // The reach grows with range.
  config.reach = {3.0, 0.1};
  EXPECT_FALSE(BlobFloats({30, 0, kGround_m + 3.5}, {}, config));
}

TEST(Support, AThingNextToTheStationIsHeldByIt) {
  const Ground ground;  // none in view
  const Support support(ground, SupportConfig());
  EXPECT_FALSE(support.IsFloating({0.6F, 0.3F, 0.8F}));
  EXPECT_TRUE(support.IsFloating({1.2F, 0.6F, 1.8F}));
}

TEST(Support, FarAwayNobodyKnows) {
  SupportConfig config;
  config.reach = {2.0, 0.0};
  for (const double max_range_m : {30.0, 70.0}) {
    config.max_range_m = max_range_m;
    EXPECT_TRUE(BlobFloats({0.6 * max_range_m, 0, 0.79 * max_range_m}, {}, config));
    EXPECT_FALSE(BlobFloats({0.6 * max_range_m, 0, 0.81 * max_range_m}, {}, config));
  }
}

TEST(Support, BeyondFarItIsTheFarReachThatCounts) {
  SupportConfig config;
  config.reach = {2.0, 0.0};
  const Eigen::Vector3d near_m(40, 0, 25);  // at 47 m
  const Eigen::Vector3d far_m(50, 0, 30);   // at 58 m
  const auto beside = [](const Eigen::Vector3d& at_m, double distance_m) {
    return Blob(at_m + Eigen::Vector3d(0, distance_m, 0));
  };
  EXPECT_TRUE(BlobFloats(near_m, beside(near_m, 3.5), config));
  EXPECT_FALSE(BlobFloats(far_m, beside(far_m, 3.5), config));
  EXPECT_FALSE(BlobFloats(far_m, beside(far_m, 18.0), config));  // the reach is 19 m
  EXPECT_TRUE(BlobFloats(far_m, beside(far_m, 20.0), config));
}

// An upright wall across the view, 10 m ahead, hit densely.
std::vector<Eigen::Vector3f> WallAhead(double low_y_m, double high_y_m) {
  std::vector<Eigen::Vector3f> points_m;
  for (double y = low_y_m; y <= high_y_m; y += 0.1) {
    for (double z = 1.0; z <= 8.0; z += 0.1) {
      points_m.push_back(Eigen::Vector3d(10.0, y, z).cast<float>());
    }
  }
  return points_m;
}

TEST(Support, AThingOfWhoseSurroundingsTooMuchIsHiddenDoesNotFloat) {
  const Eigen::Vector3d at_m(20, 0, 8);  // the reach is 3.7 m: 1.8 m on the wall
  EXPECT_TRUE(BlobFloats(at_m));
  EXPECT_TRUE(BlobFloats(at_m, WallAhead(-8.0, -2.2)));
  EXPECT_TRUE(BlobFloats(at_m, WallAhead(-8.0, -1.5)));   // a few per cent
  EXPECT_FALSE(BlobFloats(at_m, WallAhead(-8.0, -0.4)));  // more than a third
  EXPECT_FALSE(BlobFloats(at_m, WallAhead(0.4, 8.0)));
  // A wall as far away as the thing hides nothing.
  std::vector<Eigen::Vector3f> behind_m = WallAhead(-8.0, 8.0);
  for (Eigen::Vector3f& p : behind_m) p *= 2.6F;
  EXPECT_TRUE(BlobFloats(at_m, behind_m));
}

TEST(Support, WhatHasComeHighAboveTheGroundIsHeldByNothingThatIsHiddenOrFarAway) {
  const SupportConfig config;
  std::vector<Eigen::Vector3f> structure_m = FlatGround();
  const Ground ground = GroundOf(structure_m);
  const std::vector<Eigen::Vector3f> wall_m = WallAhead(-8.0, -0.4);
  structure_m.insert(structure_m.end(), wall_m.begin(), wall_m.end());
  const Support support = SupportBy(structure_m, ground, config);
  const Eigen::Vector3f beside_the_wall_m(20.0F, 0.0F, 8.0F);
  EXPECT_FALSE(support.IsFloating(beside_the_wall_m));
  EXPECT_TRUE(support.IsFloating(beside_the_wall_m, true));
  // The top of a lorry behind a hedge has come as well,
  const Eigen::Vector3f low_m(20.0F, 0.0F, 3.4F);  // 4.9 m above the ground
  EXPECT_FALSE(support.IsFloating(low_m, true));
  // and who knows how high the sky is without a ground?
  const Ground none;
  const Support up = SupportBy(wall_m, none, config);
  EXPECT_FALSE(up.IsFloating(beside_the_wall_m, true));
  // Farther away than the far reach begins.
  const Eigen::Vector3d far_m(50, 0, 30);
  const std::vector<Eigen::Vector3f> thing_m = Blob(far_m + Eigen::Vector3d(0, 12, 0));
  structure_m = FlatGround();
  structure_m.insert(structure_m.end(), thing_m.begin(), thing_m.end());
  const Support beside_a_thing = SupportBy(structure_m, ground, config);
  EXPECT_FALSE(beside_a_thing.IsFloating(far_m.cast<float>()));
  EXPECT_TRUE(beside_a_thing.IsFloating(far_m.cast<float>(), true));
  // What is near enough to be tied to it holds it in any case.
  const Eigen::Vector3f next_to_it_m = (far_m + Eigen::Vector3d(0, 7, 0)).cast<float>();
  EXPECT_FALSE(beside_a_thing.IsFloating(next_to_it_m, true));
}

TEST(Support, WithoutStructureEverythingInRangeFloats) {
  const Ground ground;
  const Support support(ground, SupportConfig());
  EXPECT_TRUE(support.IsFloating({1.0F, 2.0F, 3.0F}));
  EXPECT_FALSE(support.IsFloating({101.0F, 2.0F, 3.0F}));
}

// Clusters of structure, in all octants.
std::vector<Eigen::Vector3f> RandomStructure(Random* random) {
  std::vector<Eigen::Vector3f> points_m;
  for (int cluster = 0; cluster < 40; ++cluster) {
    const Eigen::Vector3d centre_m = random->InBox({-40, -40, -5}, {40, 40, 35});
    const double sigma_m = random->Uniform(0.05, 2.0);
    for (int i = 0; i < 20; ++i) {
      points_m.push_back((centre_m + random->NormalVector(sigma_m)).cast<float>());
    }
  }
  return points_m;
}

// A place near structure, or anywhere.
Eigen::Vector3f RandomPlace(const std::vector<Eigen::Vector3f>& structure_m, Random* random) {
  if (random->Index(4) == 0) return random->InBox({-40, -40, -5}, {40, 40, 35}).cast<float>();
  return structure_m[random->Index(structure_m.size())] + random->NormalVector(2.0).cast<float>();
}

DepthMap DepthOf(const std::vector<Eigen::Vector3f>& structure_m) {
  DepthMap depth;
  depth.Fill(structure_m);
  return depth;
}

// The first point of each voxel.
std::vector<Eigen::Vector3f> Thinned(const std::vector<Eigen::Vector3f>& points_m) {
  std::set<VoxelKey> voxels;
  std::vector<Eigen::Vector3f> thinned_m;
  for (const Eigen::Vector3f& point_m : points_m) {
    if (voxels.insert(VoxelOf(point_m, kSupportVoxelM)).second) thinned_m.push_back(point_m);
  }
  return thinned_m;
}

// By the definition, over all structure; limits that are `slack_m` narrower.
bool Floats(const Eigen::Vector3f& place_m, const std::vector<Eigen::Vector3f>& structure_m,
            const Ground& ground, const SupportConfig& config, const DepthMap& depth,
            double slack_m = 0.0) {
  const auto range_m = static_cast<double>(place_m.norm());
  const RangeRadius& radius = range_m < kSupportFarM ? config.reach : kSupportFarReach;
  const double reach_m = radius.constant_m + radius.slope * range_m;
  if (range_m > config.max_range_m || range_m < reach_m) return false;
  if (ground.HeightAbove(place_m) < reach_m) return false;
  if (depth.HiddenShare(place_m, reach_m, kObjectRadiusM, {}) > kMaxHiddenShare) return false;
  return std::none_of(structure_m.begin(), structure_m.end(), [&](const Eigen::Vector3f& other_m) {
    const auto distance_m = static_cast<double>((place_m - other_m).norm());
    return distance_m > kObjectRadiusM + slack_m && distance_m < reach_m - slack_m;
  });
}

TEST(Support, OfRandomStructureIsThatOfAllItsPoints) {
  for (std::uint32_t seed = 0; seed < 4; ++seed) {
    Random random(seed);
    const std::vector<Eigen::Vector3f> structure_m = RandomStructure(&random);
    // With and without a ground.
    const Ground ground = GroundOf(seed % 2 == 0 ? FlatGround() : std::vector<Eigen::Vector3f>());
    SupportConfig config;
    config.reach = {random.Uniform(0.5, 4.0), random.Uniform(0.0, 0.15)};
    config.max_range_m = 55.0;
    const std::vector<Eigen::Vector3f> thinned_m = Thinned(structure_m);
    const Support support = SupportBy(structure_m, ground, config);
    const Support thinned_support = SupportBy(thinned_m, ground, config);
    const DepthMap depth = DepthOf(structure_m);
    const DepthMap thinned_depth = DepthOf(thinned_m);
    const double diagonal_m = std::sqrt(3.0) * kSupportVoxelM;
    int num_floating = 0;
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3f place_m = RandomPlace(structure_m, &random);
      const bool floats = Floats(place_m, structure_m, ground, config, depth);
      num_floating += floats ? 1 : 0;
      EXPECT_EQ(thinned_support.IsFloating(place_m),
                Floats(place_m, thinned_m, ground, config, thinned_depth))
          << place_m.transpose();
      // Of a voxel one point is enough.
      if (floats) {
        EXPECT_TRUE(support.IsFloating(place_m)) << place_m.transpose();
      }
      if (!Floats(place_m, structure_m, ground, config, depth, diagonal_m)) {
        EXPECT_FALSE(support.IsFloating(place_m)) << place_m.transpose();
      }
    }
    EXPECT_GT(num_floating, 100);
    EXPECT_LT(num_floating, 1900);
  }
}

}  // namespace
}  // namespace unlidar
