#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "scene/field_of_view.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr double kDegree_rad = M_PI / 180.0;

Eigen::Vector3d At(double azimuth_rad, double elevation_deg, double range_m) {
  const double elevation_rad = elevation_deg * kDegree_rad;
  return range_m * Eigen::Vector3d(std::cos(azimuth_rad) * std::cos(elevation_rad),
                                   std::sin(azimuth_rad) * std::cos(elevation_rad),
                                   std::sin(elevation_rad));
}

// Returns of beams 1.5 degrees apart from -15 to 15 degrees, or of rays anywhere between.
std::vector<Eigen::Vector3f> Frame(bool has_rings, Random* random) {
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < 40'000; ++i) {
    const double ring = -15.0 + 1.5 * random->Index(21);
    const double elevation_deg = has_rings ? ring : random->Uniform(-15.0, 15.0);
    points_m.push_back(
        At(random->Uniform(-3.0, 3.0), elevation_deg, random->Uniform(5.0, 80.0)).cast<float>());
  }
  return points_m;
}

double ShareOf(const WatchedElevations& watched, double low_deg, double high_deg) {
  return watched.Share(At(0.5, low_deg, 30.0), At(0.5, high_deg, 30.0));
}

WatchedElevations Watched(const std::vector<Eigen::Vector3f>& points_m,
                          const CarrierPose& carrier = {}) {
  WatchedElevations watched;
  watched.AddFrame(points_m, carrier);
  watched.Update();
  return watched;
}

TEST(WatchedElevations, AllAreUntilReturnsTell) {
  WatchedElevations watched;
  EXPECT_NEAR(ShareOf(watched, -40.0, 60.0), 1.0, 1e-6);
}

TEST(WatchedElevations, BetweenBeamsNothingIs) {
  Random random(1);
  const WatchedElevations watched = Watched(Frame(true, &random));
  EXPECT_EQ(ShareOf(watched, -2.8, -1.7), 0.0);
  EXPECT_NEAR(ShareOf(watched, -3.5, -2.5), 0.1, 0.05);
  EXPECT_NEAR(ShareOf(watched, -14.0, 14.0), 0.1 / 1.5, 0.03);
}

TEST(WatchedElevations, OfOtherScansAllAreThatTheFieldOfViewHolds) {
  Random random(1);
  const WatchedElevations watched = Watched(Frame(false, &random));
  EXPECT_NEAR(ShareOf(watched, -14.0, 14.0), 1.0, 1e-6);
  EXPECT_EQ(ShareOf(watched, -40.0, -16.0), 0.0);
}

// Rain and snow have the rays of the sensor; what joins frames of another place has not.
TEST(WatchedElevations, AFewReturnsDoNotMakeABeam) {
  Random random(1);
  std::vector<Eigen::Vector3f> points_m = Frame(true, &random);
  const std::vector<Eigen::Vector3f> others_m = Frame(false, &random);
  points_m.insert(points_m.end(), others_m.begin(), others_m.begin() + 300);
  EXPECT_EQ(ShareOf(Watched(points_m), -2.8, -1.7), 0.0);
}

TEST(WatchedElevations, WhatIsAtTheViewpointHasNone) {
  const std::vector<Eigen::Vector3f> points_m(100, Eigen::Vector3f::Zero());
  const WatchedElevations watched = Watched(points_m);
  EXPECT_EQ(ShareOf(watched, -90.0, 90.0), 0.0);
  EXPECT_EQ(watched.Share(Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ()), 0.0);
}

TEST(WatchedElevations, BeamsAreOneStepApart) {
  Random random(1);
  const WatchedElevations watched = Watched(Frame(true, &random));
  for (double elevation_deg = -14.9; elevation_deg < 14.9; elevation_deg += 0.3) {
    const Eigen::Vector3d ray_m = At(0.5, elevation_deg, 30.0);
    EXPECT_NEAR(watched.BeamStepM(ray_m), 30.0 * 1.5 * kDegree_rad, 0.06) << elevation_deg;
  }
  // In the empty sky beams are as far apart as the nearest that are known.
  EXPECT_NEAR(watched.BeamStepM(At(0.5, 25.0, 30.0)), 30.0 * 1.5 * kDegree_rad, 0.1);
}

TEST(WatchedElevations, WhereAllIsWatchedOrNothingIsKnownThereIsNoStep) {
  Random random(1);
  const WatchedElevations watched = Watched(Frame(false, &random));
  EXPECT_EQ(watched.BeamStepM(At(0.5, 3.0, 30.0)), 0.0);
  EXPECT_EQ(watched.BeamStepM(At(0.5, 40.0, 30.0)), 0.0);
  EXPECT_EQ(WatchedElevations().BeamStepM(At(0.5, 3.0, 30.0)), 0.0);
}

TEST(WatchedElevations, BeamsTiltWithTheirCarrier) {
  Random random(1);
  CarrierPose carrier;
  carrier.rotation = Eigen::AngleAxisf(0.4F, Eigen::Vector3f::UnitX());
  carrier.shift_m = {3.0F, 0.0F, 1.0F};
  std::vector<Eigen::Vector3f> points_m = Frame(true, &random);
  for (Eigen::Vector3f& p : points_m) p = carrier.rotation * p + carrier.shift_m;
  EXPECT_EQ(ShareOf(Watched(points_m, carrier), -2.8, -1.7), 0.0);
}

// Evenly over azimuths from -3 to 3 and all elevations between two, seen by a carrier.
void AddEvenly(int count, double low_deg, double high_deg, const CarrierPose& carrier,
               Random* random, std::vector<Eigen::Vector3f>* points_m) {
  const double low = std::sin(low_deg * kDegree_rad);
  const double high = std::sin(high_deg * kDegree_rad);
  for (int i = 0; i < count; ++i) {
    const double elevation_deg = std::asin(random->Uniform(low, high)) / kDegree_rad;
    const Eigen::Vector3d ray_m =
        At(random->Uniform(-3.0, 3.0), elevation_deg, random->Uniform(5.0, 80.0));
    points_m->emplace_back(carrier.rotation * ray_m.cast<float>() + carrier.shift_m);
  }
}

double SteradiansOf(double low_deg, double high_deg) {
  return 6.0 * (std::sin(high_deg * kDegree_rad) - std::sin(low_deg * kDegree_rad));
}

TEST(SightDensity, IsThatOfReturnsFromAllDirections) {
  CarrierPose tilted;
  tilted.rotation = Eigen::AngleAxisf(0.3F, Eigen::Vector3f::UnitX());
  tilted.shift_m = {3.0F, 0.0F, -2.0F};
  for (const CarrierPose& carrier : {CarrierPose{}, tilted}) {
    Random random(5);
    SightDensity density;
    for (int frame = 0; frame < 40; ++frame) {
      std::vector<Eigen::Vector3f> points_m;
      AddEvenly(20'000, -30.0, 30.0, carrier, &random, &points_m);
      density.AddFrame(points_m, carrier);
    }
    EXPECT_EQ(density.PerSr(), 0.0);
    density.Update();
    const double true_per_sr = 20'000.0 / SteradiansOf(-30.0, 30.0);
    // Edges of the field of view fill a part of their cells.
    EXPECT_LT(density.PerSr(), 1.05 * true_per_sr);
    EXPECT_GT(density.PerSr(), 0.8 * true_per_sr);
  }
}

// A sensor whose lower half has five times the lines of sight, and strays all over the sky.
TEST(SightDensity, IsThatOfSparsePartsButNotOfStrays) {
  Random random(6);
  SightDensity density;
  for (int frame = 0; frame < 40; ++frame) {
    std::vector<Eigen::Vector3f> points_m;
    AddEvenly(20'000, -30.0, 0.0, {}, &random, &points_m);
    AddEvenly(4'000, 0.0, 30.0, {}, &random, &points_m);
    AddEvenly(500, 30.0, 90.0, {}, &random, &points_m);
    density.AddFrame(points_m, {});
  }
  density.Update();
  EXPECT_NEAR(density.PerSr(), 4'000.0 / SteradiansOf(0.0, 30.0), 400.0);
}

// Beams a degree to three apart, each of as many returns.
TEST(SightDensity, IsTheMeanOfBeamsAndWhatIsBetweenThem) {
  constexpr int kReturnsOfABeam = 2'000;
  for (const double step_deg : {1.0, 2.0, 3.0}) {
    Random random(7);
    SightDensity density;
    for (int frame = 0; frame < 40; ++frame) {
      std::vector<Eigen::Vector3f> points_m;
      for (double elevation_deg = -15.0; elevation_deg < 15.5; elevation_deg += step_deg) {
        for (int i = 0; i < kReturnsOfABeam; ++i) {
          points_m.push_back(At(random.Uniform(-3.0, 3.0), elevation_deg, random.Uniform(5.0, 80.0))
                                 .cast<float>());
        }
      }
      density.AddFrame(points_m, {});
    }
    density.Update();
    const double true_per_sr = kReturnsOfABeam / SteradiansOf(0.0, step_deg);
    EXPECT_LT(density.PerSr(), 1.4 * true_per_sr) << step_deg;
    EXPECT_GT(density.PerSr(), 0.7 * true_per_sr) << step_deg;
  }
}

TEST(SightDensity, OfAFrameWithoutReturnsIsUnknown) {
  SightDensity density;
  density.AddFrame(std::vector<Eigen::Vector3f>(), {});
  density.Update();
  EXPECT_EQ(density.PerSr(), 0.0);
}

}  // namespace
}  // namespace unlidar
