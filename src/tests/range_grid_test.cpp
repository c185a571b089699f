#include "scene/range_grid.hpp"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "tests/range_grid_oracle.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::IsNeighbour;
using testing::Random;

constexpr std::uint32_t kBins = 3;

// Counts per bin at a place.
std::vector<std::uint32_t> ProfileAt(const RangeGrid& grid, const Eigen::Vector3f& place_m) {
  std::vector<std::uint32_t> profile;
  for (std::uint32_t bin = 0; bin < kBins; ++bin) {
    profile.push_back(grid.Count(place_m, {bin, bin + 1}));
  }
  return profile;
}

// Points at all ranges up to `reach_m`, as dense near as far.
std::vector<Eigen::Vector3f> Cloud(Random* random, int count, double reach_m) {
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d direction = random->NormalVector(1.0).normalized();
    points_m.emplace_back((direction * random->Uniform(0.0, reach_m)).cast<float>());
  }
  return points_m;
}

// Pairs that lie near each other at any range: a cloud and a copy moved by about a radius.
std::vector<Eigen::Vector3f> NeighboursOf(const std::vector<Eigen::Vector3f>& points_m,
                                          const RangeRadius& radius, Random* random) {
  std::vector<Eigen::Vector3f> neighbours_m;
  for (const Eigen::Vector3f& p : points_m) {
    const double size_m = radius.At(static_cast<double>(p.norm()));
    neighbours_m.push_back(p + random->NormalVector(0.7 * size_m).cast<float>());
  }
  return neighbours_m;
}

void ExpectCountsOfTheBlocks(const RangeRadius& radius, double reach_m) {
  Random random(1);
  const std::vector<Eigen::Vector3f> places_m = Cloud(&random, 500, reach_m);
  std::vector<Eigen::Vector3f> points_m = NeighboursOf(places_m, radius, &random);
  const std::vector<Eigen::Vector3f> others_m = Cloud(&random, 1500, 1.5 * reach_m);
  points_m.insert(points_m.end(), others_m.begin(), others_m.end());
  RangeGrid grid(radius);
  for (std::uint32_t i = 0; i < points_m.size(); ++i) grid.Add(points_m[i], i % kBins);
  std::uint32_t total = 0;
  for (const Eigen::Vector3f& place_m : places_m) {
    std::vector<std::uint32_t> expected(kBins, 0);
    for (std::size_t i = 0; i < points_m.size(); ++i) {
      if (IsNeighbour(radius, place_m, points_m[i])) ++expected[i % kBins];
    }
    ASSERT_EQ(ProfileAt(grid, place_m), expected) << "at " << place_m.transpose();
    for (const std::uint32_t count : expected) total += count;
  }
  EXPECT_GT(total, 100U);  // it was about something
}

TEST(RangeGrid, CountsWhatLiesInTheBlockWhateverShellsItReachesInto) {
  ExpectCountsOfTheBlocks({0.35, 0.012}, 300.0);
  ExpectCountsOfTheBlocks({0.5, 0.0}, 30.0);
  ExpectCountsOfTheBlocks({1.5, 0.04}, 300.0);
  ExpectCountsOfTheBlocks({4.0, 0.12}, 300.0);
}

TEST(RangeGrid, CountsTheBlockOfARadiusAsSteepAsThatOfWideClutter) {
  ExpectCountsOfTheBlocks({4.0, 0.35}, 300.0);
}

TEST(RangeGrid, CountsWhatIsNearAndNothingThatIsFar) {
  const RangeRadius radius{0.35, 0.012};
  // A shell's radius is within 2^(1/4) of the radius of its places; the block reaches from 2/3 of
  // it along an axis to 4/3 of it in each, that is along the diagonal sqrt(3) as far.
  const double step = std::pow(2.0, 0.25);
  const double surely_in = 2.0 / 3.0 / step;
  const double surely_out = 4.0 / 3.0 * std::sqrt(3.0) * step;
  Random random(2);
  for (const Eigen::Vector3f& place_m : Cloud(&random, 2000, 300.0)) {
    const double radius_m = radius.At(static_cast<double>(place_m.norm()));
    const Eigen::Vector3f direction = random.NormalVector(1.0).normalized().cast<float>();
    const auto counts_at = [&](double distance_m) {
      RangeGrid grid(radius);
      grid.Add(place_m + static_cast<float>(distance_m) * direction, 0);
      return grid.Count(place_m);
    };
    EXPECT_EQ(counts_at(0.999 * surely_in * radius_m), 1U) << place_m.transpose();
    EXPECT_EQ(counts_at(1.001 * surely_out * radius_m), 0U) << place_m.transpose();
  }
}

TEST(RangeGrid, TakesNoFarPointForANearOne) {
  const RangeRadius radius{0.35, 0.012};
  Random random(3);
  RangeGrid grid(radius);
  for (const double range_m : {2e3, 2e4, 1e5, 1e6}) {
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3d direction = random.NormalVector(1.0).normalized();
      grid.Add((range_m * direction).cast<float>(), 0);
    }
  }
  for (const Eigen::Vector3f& place_m : Cloud(&random, 20'000, 1000.0)) {
    ASSERT_EQ(grid.Count(place_m), 0U) << place_m.transpose();
  }
}

// In any order of bins, and whatever was asked between: what was taken away or forgotten might
// never have been added.
TEST(RangeGrid, WhatIsTakenAwayOrForgottenCountsNoMore) {
  const RangeRadius radius{0.35, 0.012};
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    Random random(seed);
    const bool is_cached = seed % 2 == 0;
    RangeGrid grid(radius,
                   is_cached ? RangeGrid::CountCache::kPerVoxel : RangeGrid::CountCache::kNone);
    std::vector<std::pair<Eigen::Vector3f, std::uint32_t>> points;
    std::uint32_t forgotten = 0;
    for (int i = 0; i < 3000; ++i) {
      const std::uint32_t action = random.Index(10);
      if (action == 0 && !points.empty()) {
        const std::uint32_t k = random.Index(points.size());
        if (points[k].second >= forgotten) grid.Add(points[k].first, points[k].second, -1);
        points.erase(points.begin() + k);
      } else if (action == 1 && random.Index(20) == 0) {
        grid.Forget(++forgotten);
      } else {
        const Eigen::Vector3f point_m = random.InBox({18, -1, -1}, {22, 1, 1}).cast<float>();
        points.emplace_back(point_m, forgotten + random.Index(kBins));
        grid.Add(point_m, points.back().second);
      }
      const Eigen::Vector3f asked_m = random.InBox({18, -1, -1}, {22, 1, 1}).cast<float>();
      grid.Count(asked_m);
      grid.Count(asked_m, {forgotten, forgotten + 1 + random.Index(kBins)});
    }
    RangeGrid expected(radius);
    for (const auto& [point_m, bin] : points) {
      if (bin >= forgotten) expected.Add(point_m, bin);
    }
    for (int trial = 0; trial < 100; ++trial) {
      const Eigen::Vector3f place_m = random.InBox({18, -1, -1}, {22, 1, 1}).cast<float>();
      EXPECT_EQ(grid.Count(place_m), expected.Count(place_m));
      for (std::uint32_t bin = 0; bin < forgotten + kBins; ++bin) {
        ASSERT_EQ(grid.Count(place_m, {bin, bin + 1}), expected.Count(place_m, {bin, bin + 1}));
      }
    }
  }
}

TEST(RangeGrid, VolumeIsThatOfTheCountedBlock) {
  const RangeRadius radius{0.35, 0.012};
  Random random(5);
  for (const double range_m : {1.0, 30.0, 200.0}) {
    const Eigen::Vector3f place_m(static_cast<float>(range_m), 0.1F, 0.2F);
    const double half_m = 4.0 * radius.At(range_m);
    const Eigen::Vector3d half(half_m, half_m, half_m);
    RangeGrid grid(radius);
    constexpr int kPoints = 200'000;
    for (int i = 0; i < kPoints; ++i) {
      grid.Add(place_m + random.InBox(-half, half).cast<float>(), 0);
    }
    const double expected = kPoints * grid.VolumeM3(place_m) / std::pow(2.0 * half_m, 3);
    EXPECT_NEAR(grid.Count(place_m), expected, 4.0 * std::sqrt(expected)) << range_m;
  }
}

TEST(RangeGrid, CountsHoweverFarAwayAPlaceIs) {
  for (const float at_m : {1e5F, 9e5F, 1e6F, 2e6F}) {
    RangeGrid grid({0.35, 0.012});
    const Eigen::Vector3f place_m(at_m, -at_m, at_m);
    for (const std::uint32_t bin : {1U, 2U, 1U, 0U, 2U, 1U}) grid.Add(place_m, bin);
    EXPECT_EQ(ProfileAt(grid, place_m), (std::vector<std::uint32_t>{1, 3, 2})) << at_m;
  }
}

TEST(RangeGrid, HoldsTheBinsOfThePointsOnlyHoweverManyThereAre) {
  constexpr std::uint32_t kLast = 4'000'000'000U;
  RangeGrid grid({0.35, 0.012});
  const Eigen::Vector3f place_m(10.0F, 5.0F, 2.0F);
  grid.Add(place_m, kLast, 7);
  grid.Add(place_m, 1);
  EXPECT_EQ(grid.Count(place_m), 8U);
  EXPECT_EQ(grid.Count(place_m, {0, kLast}), 1U);
  EXPECT_EQ(grid.Count(place_m, {kLast, kLast + 1}), 7U);
  EXPECT_EQ(grid.Count(place_m, {2, kLast}), 0U);
}

TEST(RangeGrid, TheSpanOfAPlaceIsFromItsFirstBinWithPointsToItsLast) {
  constexpr std::uint32_t kManyBins = 1000;
  Random random(6);
  RangeGrid grid({0.35, 0.012});
  const auto in_box = [&] { return random.InBox({5, -4, 0}, {13, 4, 4}).cast<float>().eval(); };
  for (int i = 0; i < 20'000; ++i) grid.Add(in_box(), random.Index(kManyBins));
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3f place_m = in_box();
    std::vector<std::uint32_t> bins;
    for (std::uint32_t bin = 0; bin < kManyBins; ++bin) {
      if (grid.Count(place_m, {bin, bin + 1}) > 0) bins.push_back(bin);
    }
    ASSERT_GT(bins.size(), 1U);
    EXPECT_EQ(grid.SpanOf(place_m), (BinRange{bins.front(), bins.back() + 1}));
  }
}

}  // namespace
}  // namespace unlidar
