#include "unlidar/robust/range_grid.hpp"

#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "range_grid_oracle.hpp"
#include "synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::IsNeighbour;
using testing::Random;

constexpr std::size_t kBins = 3;

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
  RangeGrid grid(radius, kBins);
  for (std::size_t i = 0; i < points_m.size(); ++i) grid.Add(points_m[i], i % kBins);
  std::uint32_t total = 0;
  for (const Eigen::Vector3f& place_m : places_m) {
    std::vector<std::uint32_t> profile(kBins, 0);
    grid.Collect(place_m, &profile);
    std::vector<std::uint32_t> expected(kBins, 0);
    for (std::size_t i = 0; i < points_m.size(); ++i) {
      if (IsNeighbour(radius, place_m, points_m[i])) ++expected[i % kBins];
    }
    ASSERT_EQ(profile, expected) << "at " << place_m.transpose();
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
      RangeGrid grid(radius, 1);
      grid.Add(place_m + static_cast<float>(distance_m) * direction, 0);
      std::vector<std::uint32_t> profile(1, 0);
      grid.Collect(place_m, &profile);
      return profile[0];
    };
    EXPECT_EQ(counts_at(0.999 * surely_in * radius_m), 1U) << place_m.transpose();
    EXPECT_EQ(counts_at(1.001 * surely_out * radius_m), 0U) << place_m.transpose();
  }
}

TEST(RangeGrid, TakesNoFarPointForANearOne) {
  const RangeRadius radius{0.35, 0.012};
  Random random(3);
  RangeGrid grid(radius, 1);
  for (const double range_m : {2e3, 2e4, 1e5, 1e6}) {
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3d direction = random.NormalVector(1.0).normalized();
      grid.Add((range_m * direction).cast<float>(), 0);
    }
  }
  std::vector<std::uint32_t> profile(1, 0);
  for (const Eigen::Vector3f& place_m : Cloud(&random, 20'000, 1000.0)) {
    grid.Collect(place_m, &profile);
  }
  EXPECT_EQ(profile[0], 0U);
}

TEST(RangeGrid, PlacesWithOneKeyHaveOneNeighbourhood) {
  const RangeRadius radius{0.35, 0.012};
  Random random(4);
  RangeGrid grid(radius, 1);
  std::vector<Eigen::Vector3f> places_m;
  for (int i = 0; i < 3000; ++i) {
    places_m.emplace_back(random.InBox({55, -2, -2}, {61, 2, 2}).cast<float>());
    grid.Add(places_m.back(), 0);
  }
  std::map<std::uint64_t, std::pair<std::uint32_t, double>> of_key;
  for (const Eigen::Vector3f& place_m : places_m) {
    std::vector<std::uint32_t> profile(1, 0);
    grid.Collect(place_m, &profile);
    const auto found = std::make_pair(profile[0], grid.VolumeM3(place_m));
    EXPECT_EQ(of_key.try_emplace(grid.Key(place_m), found).first->second, found);
  }
  EXPECT_LT(of_key.size(), 1500U);
}

TEST(RangeGrid, VolumeIsThatOfTheCountedBlock) {
  const RangeRadius radius{0.35, 0.012};
  Random random(5);
  for (const double range_m : {1.0, 30.0, 200.0}) {
    const Eigen::Vector3f place_m(static_cast<float>(range_m), 0.1F, 0.2F);
    const double half_m = 4.0 * radius.At(range_m);
    const Eigen::Vector3d half(half_m, half_m, half_m);
    RangeGrid grid(radius, 1);
    constexpr int kPoints = 200'000;
    for (int i = 0; i < kPoints; ++i) {
      grid.Add(place_m + random.InBox(-half, half).cast<float>(), 0);
    }
    std::vector<std::uint32_t> profile(1, 0);
    grid.Collect(place_m, &profile);
    const double expected = kPoints * grid.VolumeM3(place_m) / std::pow(2.0 * half_m, 3);
    EXPECT_NEAR(profile[0], expected, 4.0 * std::sqrt(expected)) << range_m;
  }
}

TEST(RangeGrid, CountsHoweverFarAwayAPlaceIs) {
  for (const float at_m : {1e5F, 9e5F, 1e6F, 2e6F}) {
    RangeGrid grid({0.35, 0.012}, kBins);
    const Eigen::Vector3f place_m(at_m, -at_m, at_m);
    for (const std::size_t bin : {1U, 2U, 1U, 0U, 2U, 1U}) grid.Add(place_m, bin);
    std::vector<std::uint32_t> profile(kBins, 0);
    grid.Collect(place_m, &profile);
    EXPECT_EQ(profile, (std::vector<std::uint32_t>{1, 3, 2})) << at_m;
  }
}

TEST(RangeGrid, AddsCountsToWhatTheProfileHolds) {
  RangeGrid grid({0.35, 0.012}, kBins);
  const Eigen::Vector3f place_m(10.0F, 5.0F, 2.0F);
  grid.Add(place_m, 1, 7);
  grid.Add(place_m, 2);
  std::vector<std::uint32_t> profile = {1, 1, 1};
  grid.Collect(place_m, &profile);
  EXPECT_EQ(profile, (std::vector<std::uint32_t>{1, 8, 2}));
}

}  // namespace
}  // namespace unlidar
