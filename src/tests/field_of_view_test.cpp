#include "scene/field_of_view.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr double kDegRad = M_PI / 180.0;

Eigen::Vector3f Towards(double azimuth_rad, double elevation_rad, double range_m) {
  return (range_m * Eigen::Vector3d(std::cos(azimuth_rad) * std::cos(elevation_rad),
                                    std::sin(azimuth_rad) * std::cos(elevation_rad),
                                    std::sin(elevation_rad)))
      .cast<float>();
}

ElevationRange EdgesOf(const std::vector<Eigen::Vector3f>& points_m) {
  FieldOfView view;
  view.AddFrame(points_m, {});
  return view.Edges();
}

void ExpectUnknown(const std::vector<Eigen::Vector3f>& points_m) {
  const ElevationRange edges = EdgesOf(points_m);
  EXPECT_EQ(edges.lowest_rad, -M_PI / 2);
  EXPECT_EQ(edges.highest_rad, M_PI / 2);
}

// Beams from -8 to 5 degrees which hit something in a part of all azimuths.
std::vector<Eigen::Vector3f> Scan(double azimuths_rad, Random* random) {
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 20000; ++i) {
    const double elevation_rad = (-8.0 + 0.5 * random->Index(27)) * kDegRad;
    points_m.push_back(Towards(random->Uniform(-0.5, 0.5) * azimuths_rad, elevation_rad,
                               random->Uniform(3.0, 60.0)));
  }
  return points_m;
}

TEST(FieldOfView, EndsWhereReturnsOfManyAzimuthsDo) {
  Random random(1);
  for (const double azimuths_rad : {1.0, 3.0, 2.0 * M_PI}) {
    const ElevationRange edges = EdgesOf(Scan(azimuths_rad, &random));
    EXPECT_NEAR(edges.lowest_rad, -8.0 * kDegRad, 1e-6);
    EXPECT_NEAR(edges.highest_rad, 5.0 * kDegRad, 1e-6);
  }
}

TEST(FieldOfView, DoesNotEndWhereAnythingIsSeenBeyond) {
  Random random(2);
  std::vector<Eigen::Vector3f> points_m = Scan(2.0 * M_PI, &random);
  points_m.push_back(Towards(1.0, 20.0 * kDegRad, 30.0));  // a drone
  EXPECT_EQ(EdgesOf(points_m).highest_rad, M_PI / 2);
  EXPECT_NEAR(EdgesOf(points_m).lowest_rad, -8.0 * kDegRad, 1e-6);
}

TEST(FieldOfView, DoesNotEndAtARoofOrAtTrees) {
  Random random(3);
  std::vector<Eigen::Vector3f> wall_m;
  std::vector<Eigen::Vector3f> trees_m;
  for (int i = 0; i < 20000; ++i) {
    wall_m.push_back(Eigen::Vector3d(12.0, random.Uniform(-20.0, 20.0), random.Uniform(-1.5, 6.0))
                         .cast<float>());
    const double azimuth_rad = random.Uniform(-M_PI, M_PI);
    const double top_deg = 12.0 + 3.0 * std::sin(7.0 * azimuth_rad);
    trees_m.push_back(Towards(azimuth_rad, random.Uniform(0.0, top_deg) * kDegRad, 30.0));
  }
  ExpectUnknown(wall_m);
  EXPECT_EQ(EdgesOf(trees_m).highest_rad, M_PI / 2);
}

TEST(FieldOfView, OfNothingOrOfOneReturnIsUnknown) {
  ExpectUnknown({});
  ExpectUnknown({Towards(0.0, 0.1, 9.0)});
}

TEST(FieldOfView, DoesNotEndAboveItsLowestReturn) {
  FieldOfView view;
  EXPECT_EQ(view.LowestRad(), 0.0);
  for (const double elevation_rad : {0.3, 0.1, 0.2, -0.1, 0.0}) {
    view.AddFrame(std::vector<Eigen::Vector3f>{Towards(1.0, elevation_rad, 9.0)}, {});
    EXPECT_LE(view.LowestRad(), elevation_rad + 1e-6);
  }
  EXPECT_NEAR(view.LowestRad(), -0.1, 1e-6);
}

TEST(FieldOfView, IsTheSameInWhateverOrderReturnsCome) {
  Random random(4);
  std::vector<Eigen::Vector3f> points_m = Scan(3.0, &random);
  const ElevationRange edges = EdgesOf(points_m);
  const auto is_lower = [](const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
    return a.z() / a.norm() < b.z() / b.norm();
  };
  std::sort(points_m.begin(), points_m.end(), is_lower);
  for (int turn = 0; turn < 2; ++turn) {
    EXPECT_EQ(EdgesOf(points_m).lowest_rad, edges.lowest_rad);
    EXPECT_EQ(EdgesOf(points_m).highest_rad, edges.highest_rad);
    std::reverse(points_m.begin(), points_m.end());
  }
}

TEST(LowestElevation, HasOneReturnInAHundredBelowIt) {
  Random random(5);
  std::vector<Eigen::Vector3f> points_m;
  for (int k = 0; k < 5000; ++k) {
    points_m.push_back(Towards(random.Uniform(-M_PI, M_PI), random.Uniform(-0.5, 0.5), 9.0));
  }
  const double lowest_rad = LowestElevationRad(points_m);
  const auto num_below =
      std::count_if(points_m.begin(), points_m.end(), [&](const Eigen::Vector3f& point_m) {
        return std::asin(static_cast<double>(point_m.z() / point_m.norm())) < lowest_rad;
      });
  EXPECT_EQ(num_below, 50);
  EXPECT_NEAR(LowestElevationRad({Towards(1.0, 0.1, 9.0)}), 0.1, 1e-6);
}

}  // namespace
}  // namespace unlidar
