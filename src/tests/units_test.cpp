#include "io/units.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr double kMaxRangeM = 2000.0;

// Returns in the open about a sensor, in a unit of so many metres, from a place of the map.
RangeStatistics Scene(double unit_m, const Eigen::Vector3d& place_m = Eigen::Vector3d::Zero()) {
  Random random(1);
  RangeStatistics ranges;
  for (int i = 0; i < 2000; ++i) {
    const double range_m = 3.0 * std::exp(random.Uniform(0.0, 3.0));
    const double azimuth = random.Uniform(-M_PI, M_PI);
    const Eigen::Vector3d point_m(range_m * std::cos(azimuth), range_m * std::sin(azimuth), 1.0);
    const Eigen::Vector3d read = (point_m + place_m) / unit_m;
    ranges.Add(read, read.norm());
  }
  return ranges;
}

std::string Why(const RangeStatistics& ranges, double max_range_m = kMaxRangeM) {
  return WhyNotMetres(ranges, max_range_m).value_or("");
}

TEST(Units, MetresAreMetres) {
  EXPECT_EQ(Why(Scene(1.0)), "");
  EXPECT_FALSE(WarningOfRanges("a", Scene(1.0), kMaxRangeM));
}

TEST(Units, MillimetresAndCentimetresAreNamedWithTheScaleThatReadsThem) {
  const std::string millimetres = Why(Scene(0.001));
  EXPECT_NE(millimetres.find("millimetres"), std::string::npos) << millimetres;
  EXPECT_NE(millimetres.find("input.scale_m=0.001"), std::string::npos) << millimetres;
  const std::string centimetres = Why(Scene(0.01));
  EXPECT_NE(centimetres.find("centimetres"), std::string::npos) << centimetres;
  EXPECT_NE(centimetres.find("input.scale_m=0.01"), std::string::npos) << centimetres;
}

TEST(Units, CoordinatesOfAMapAreNamed) {
  const std::string why = Why(Scene(1.0, {465'000.0, 5'250'000.0, 400.0}));
  EXPECT_NE(why.find("UTM"), std::string::npos) << why;
}

TEST(Units, AMapWhoseOriginIsNearIsInDoubt) {
  const RangeStatistics ranges = Scene(1.0, {1'100.0, -900.0, 20.0});
  EXPECT_EQ(Why(ranges), "");  // its returns are within input.max_range_m
  const auto warning = WarningOfRanges("a", ranges, kMaxRangeM);
  ASSERT_TRUE(warning);
  EXPECT_EQ(warning->code, "map_coordinates");
}

TEST(Units, KilometresAreInDoubt) {
  const auto warning = WarningOfRanges("a", Scene(1000.0), kMaxRangeM);
  ASSERT_TRUE(warning);
  EXPECT_EQ(warning->code, "returns_too_near");
}

// Returns about a sensor in a unit of so many metres, `per_frame` in each of 20 frames, with ranges
// that are spread evenly by their logarithm.
RangeStatistics Frames(double unit_m, double nearest_m, double farthest_m, int per_frame) {
  Random random(1);
  RangeStatistics all;
  for (int frame = 0; frame < 20; ++frame) {
    for (int i = 0; i < per_frame; ++i) {
      const double range_m =
          nearest_m * std::exp(random.Uniform(0.0, std::log(farthest_m / nearest_m)));
      all.Add(Eigen::Vector3d::UnitX() * range_m / unit_m, range_m / unit_m);
    }
    all.EndFrame();
  }
  return all;
}

TEST(Units, CentimetresOfARoomOrAYardAreInDoubt) {
  for (const double farthest_m : {3.0, 5.0, 8.0, 15.0}) {
    const RangeStatistics small = Frames(0.01, 0.6, farthest_m, 1000);
    EXPECT_EQ(Why(small), "");
    EXPECT_NE(WhyCentimetres(small).value_or("").find("input.scale_m=0.01"), std::string::npos);
    EXPECT_FALSE(WhyCentimetres(Frames(1.0, 0.6, farthest_m, 1000)));
  }
}

TEST(Units, MetresOfAnOpenPlaceAreNoCentimetres) {
  EXPECT_FALSE(WhyCentimetres(Frames(1.0, 10.0, 450.0, 1000)));
}

TEST(Units, ASkyAloneIsNoCentimetres) {
  EXPECT_FALSE(WhyCentimetres(Frames(1.0, 80.0, 430.0, 150)));    // strays
  EXPECT_FALSE(WhyCentimetres(Frames(1.0, 150.0, 300.0, 1000)));  // clouds
}

TEST(Units, HundredthsOfMetresAreInDoubtAndASmallRoomIsNot) {
  const auto warning = WarningOfRanges("a", Frames(100.0, 3.0, 90.0, 1000), kMaxRangeM);
  ASSERT_TRUE(warning);
  EXPECT_EQ(warning->code, "returns_too_near");
  EXPECT_FALSE(WarningOfRanges("a", Frames(1.0, 0.3, 1.5, 1000), kMaxRangeM));
}

TEST(Units, ALidarThatReachesFartherIsBelievedWhereTheConfigSaysSo) {
  const RangeStatistics far = Scene(0.02);  // the middle return at 700 m
  EXPECT_NE(Why(far), "");
  EXPECT_EQ(Why(far, 20'000.0), "");
}

TEST(Units, AFewStraysTellNothing) {
  RangeStatistics strays;
  for (int i = 0; i < 10; ++i) strays.Add({0.0, 0.0, 900.0}, 900.0);
  EXPECT_EQ(Why(strays), "");
}

TEST(Units, OnlyManyReturnsOfSeveralFramesAreEnoughToRefuse) {
  const auto of = [](int frames, int returns_each) {
    RangeStatistics all;
    for (int k = 0; k < frames; ++k) {
      for (int i = 0; i < returns_each; ++i) all.Add({0.0, 0.0, 900.0}, 900.0);
      EXPECT_EQ(all.EndFrame(), returns_each > 0);
    }
    return SufficeToRefuse(all);
  };
  EXPECT_TRUE(of(5, 400));
  EXPECT_FALSE(of(4, 5'000));
  EXPECT_FALSE(of(500, 3));
  EXPECT_FALSE(of(500, 0));
}

TEST(Units, AbsurdCoordinatesBreakNothing) {
  RangeStatistics ranges = Scene(1.0);
  ranges.Add({3e38, 0.0, 0.0}, 3e38);
  ranges.Add({0.0, 0.0, 1e-40}, 1e-40);
  EXPECT_EQ(Why(ranges), "");
}

TEST(Units, QuantilesAreRightToAnEighthOfAnOctave) {
  RangeStatistics ranges;
  for (int i = 1; i <= 1000; ++i) ranges.Add({0.0, 0.0, i / 10.0}, i / 10.0);
  for (const double share : {0.1, 0.5, 0.9}) {
    EXPECT_LE(ranges.Quantile(share), 100.0 * share);
    EXPECT_GT(ranges.Quantile(share), 100.0 * share / 1.126);
  }
}

}  // namespace
}  // namespace unlidar
