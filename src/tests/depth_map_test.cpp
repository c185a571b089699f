#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "base/angles.hpp"
#include "scene/support.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr double kDegree_rad = M_PI / 180.0;
constexpr double kMargin_m = 2.0;

Eigen::Vector3f Towards(double azimuth_rad, double elevation_rad, double range_m) {
  return (range_m * Eigen::Vector3d(std::cos(elevation_rad) * std::cos(azimuth_rad),
                                    std::cos(elevation_rad) * std::sin(azimuth_rad),
                                    std::sin(elevation_rad)))
      .cast<float>();
}

DepthMap MapOf(const std::vector<Eigen::Vector3f>& points_m) {
  DepthMap map;
  map.Fill(points_m);
  return map;
}

// A wall 10 m ahead, hit so densely that no direction goes through it.
std::vector<Eigen::Vector3f> Wall(double low_y_m, double high_y_m) {
  std::vector<Eigen::Vector3f> points_m;
  for (double y = low_y_m; y <= high_y_m; y += 0.05) {
    for (double z = -8.0; z <= 8.0; z += 0.05) {
      points_m.push_back(Eigen::Vector3d(10.0, y, z).cast<float>());
    }
  }
  return points_m;
}

// Returns at 10 m in all directions on one side of the zenith.
std::vector<Eigen::Vector3f> HalfADome() {
  std::vector<Eigen::Vector3f> points_m;
  Random random(1);
  while (points_m.size() < 200'000) {
    const Eigen::Vector3d p = random.NormalVector(1.0);
    if (p.x() > 0.0 && p.z() > 0.0) points_m.push_back((10.0 * p.normalized()).cast<float>());
  }
  return points_m;
}

TEST(DepthMap, APlaceIsHiddenBehindTheMedianRangeOfItsCell) {
  constexpr double kCell_deg = 2.0;
  constexpr double kNarrow_m = 1e-6;  // so that the cell of the place counts alone
  Random random(2);
  // Cells are counted from straight behind, and from straight below.
  const auto cell_of = [](const Eigen::Vector3f& p) {
    const Eigen::Vector3d d = p.cast<double>();
    const double azimuth_deg = std::atan2(d.y(), d.x()) / kDegree_rad + 180.0;
    const double elevation_deg = std::asin(d.z() / d.norm()) / kDegree_rad + 90.0;
    return std::array<int, 2>{static_cast<int>(azimuth_deg / kCell_deg),
                              static_cast<int>(elevation_deg / kCell_deg)};
  };
  DepthMap map;
  for (int fill = 0; fill < 3; ++fill) {  // anew each time
    std::vector<Eigen::Vector3f> points_m;
    std::map<std::array<int, 2>, std::vector<float>> ranges_m;
    for (int i = 0; i < 40'000; ++i) {
      points_m.push_back(random.NormalVector(20.0).cast<float>());
      ranges_m[cell_of(points_m.back())].push_back(points_m.back().norm());
    }
    map.Fill(points_m);
    int num_empty = 0;
    for (int i = 0; i < 4000; ++i) {
      const Eigen::Vector3f towards_m = random.NormalVector(1.0).cast<float>().normalized();
      const auto hidden_share = [&](float range_m, double margin_m) {
        return map.HiddenShare(range_m * towards_m, kNarrow_m, margin_m, {});
      };
      std::vector<float>& in_cell_m = ranges_m[cell_of(towards_m)];
      if (in_cell_m.empty()) {
        EXPECT_EQ(hidden_share(1e6F, 0.0), 0.0);
        ++num_empty;
        continue;
      }
      std::sort(in_cell_m.begin(), in_cell_m.end());
      const float median_m = in_cell_m[in_cell_m.size() / 2];
      EXPECT_EQ(hidden_share(1.001F * median_m, 0.0), 1.0);
      EXPECT_EQ(hidden_share(0.999F * median_m, 0.0), 0.0);
      EXPECT_EQ(hidden_share(1.001F * median_m, 0.01 * static_cast<double>(median_m)), 0.0);
    }
    EXPECT_GT(num_empty, 10);
    EXPECT_LT(num_empty, 2000);
  }
}

TEST(DepthMap, WithoutReturnsHidesNothing) {
  EXPECT_EQ(MapOf({}).HiddenShare({10.0F, 2.0F, 3.0F}, 5.0, kMargin_m, {}), 0.0);
}

TEST(DepthMap, AHalfIsHiddenAtTheEdgeOfANearerWallAllBehindItAndNothingBeside) {
  const DepthMap map = MapOf(Wall(-8.0, 0.0));
  const double radius_m = 4.0;
  EXPECT_NEAR(map.HiddenShare({20.0F, 0.0F, 0.0F}, radius_m, kMargin_m, {}), 0.5, 0.15);
  EXPECT_EQ(map.HiddenShare({20.0F, -8.0F, 0.0F}, radius_m, kMargin_m, {}), 1.0);
  EXPECT_EQ(map.HiddenShare({20.0F, 5.5F, 0.0F}, radius_m, kMargin_m, {}), 0.0);
  EXPECT_EQ(MapOf({}).HiddenShare({20.0F, 0.0F, 0.0F}, radius_m, kMargin_m, {}), 0.0);
}

TEST(DepthMap, WhatIsNotNearerByTheMarginHidesNothing) {
  const DepthMap map = MapOf(Wall(-8.0, 8.0));
  EXPECT_EQ(map.HiddenShare({11.5F, 0.0F, 0.0F}, 2.0, kMargin_m, {}), 0.0);
  EXPECT_EQ(map.HiddenShare({8.0F, 0.0F, 0.0F}, 2.0, kMargin_m, {}), 0.0);
  EXPECT_EQ(map.HiddenShare({13.0F, 0.0F, 0.0F}, 2.0, kMargin_m, {}), 1.0);
}

TEST(DepthMap, CountsDirectionsAlikeAlsoAroundTheZenith) {
  const DepthMap map = MapOf(HalfADome());
  for (const double azimuth_rad : {0.3, 1.2, 2.5, -2.0}) {
    // Half a degree beside the zenith: cells about it are of all azimuths.
    const Eigen::Vector3f place_m = Towards(azimuth_rad, 89.5 * kDegree_rad, 20.0);
    EXPECT_NEAR(map.HiddenShare(place_m, 5.0, kMargin_m, {}), 0.5, 0.1) << azimuth_rad;
  }
  EXPECT_EQ(map.HiddenShare(Towards(0.0, 60.0 * kDegree_rad, 20.0), 5.0, kMargin_m, {}), 1.0);
  EXPECT_EQ(map.HiddenShare(Towards(M_PI, 60.0 * kDegree_rad, 20.0), 5.0, kMargin_m, {}), 0.0);
}

TEST(DepthMap, SeesNoSeamBehindTheSensor) {
  std::vector<Eigen::Vector3f> behind_m;
  for (const Eigen::Vector3f& p : Wall(-8.0, 0.0)) behind_m.emplace_back(-p.x(), -p.y(), p.z());
  const DepthMap map = MapOf(behind_m);
  EXPECT_NEAR(map.HiddenShare({-20.0F, 0.0F, 0.0F}, 4.0, kMargin_m, {}), 0.5, 0.15);
  EXPECT_EQ(map.HiddenShare({-20.0F, 8.0F, 0.0F}, 4.0, kMargin_m, {}), 1.0);
  EXPECT_EQ(map.HiddenShare({-20.0F, -5.5F, 0.0F}, 4.0, kMargin_m, {}), 0.0);
}

TEST(DepthMap, WithinASphereAllIsHiddenWhateverTheDirection) {
  std::vector<Eigen::Vector3f> sphere_m;  // with a return in each cell
  for (double azimuth_deg = -179.5; azimuth_deg < 180.0; azimuth_deg += 1.0) {
    for (double elevation_deg = -89.5; elevation_deg < 90.0; elevation_deg += 1.0) {
      sphere_m.push_back(Towards(azimuth_deg * kDegree_rad, elevation_deg * kDegree_rad, 5.0));
    }
  }
  const DepthMap map = MapOf(sphere_m);
  for (const double azimuth_deg : {-180.0, -179.0, -90.0, 0.0, 91.0, 179.0, 180.0}) {
    for (const double elevation_deg : {-89.0, 0.0, 45.0, 84.0, 88.0, 90.0}) {
      const Eigen::Vector3f place_m =
          Towards(azimuth_deg * kDegree_rad, elevation_deg * kDegree_rad, 20.0);
      EXPECT_NEAR(map.HiddenShare(place_m, 2.0, kMargin_m, {}), 1.0, 1e-9)
          << azimuth_deg << ' ' << elevation_deg;
    }
  }
}

TEST(Angles, TheApproximateArcTangentIsWithinItsBound) {
  for (int k = -400'000; k <= 400'000; ++k) {
    const double rad = M_PI * k / 400'000.0;
    const double y = 3.0 * std::sin(rad);
    const double x = 3.0 * std::cos(rad);
    ASSERT_NEAR(ApproximateAtan2(y, x), std::atan2(y, x), kApproximateAtan2ErrorRad) << rad;
  }
  EXPECT_EQ(ApproximateAtan2(0.0, 0.0), 0.0);
}

TEST(Angles, AColumnOfAzimuthsIsThatOfTheExactAngleAlsoAtItsEdges) {
  for (int edge = -36; edge <= 36; ++edge) {
    for (const double off_rad : {-1e-3, -1e-5, -1e-7, 0.0, 1e-7, 1e-5, 1e-3}) {
      const Eigen::Vector3f p = Towards(edge * 5.0 * kDegree_rad + off_rad, 0.3, 20.0);
      const double turns = (AzimuthRad(p) + M_PI) / (2.0 * M_PI);
      const auto column = std::min<std::size_t>(static_cast<std::size_t>(72.0 * turns), 71);
      EXPECT_EQ(AzimuthColumn(p), column) << edge << ' ' << off_rad;
    }
  }
}

}  // namespace
}  // namespace unlidar
