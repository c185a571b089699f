#include "base/voxel_numbers.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <iterator>
#include <map>
#include <utility>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr std::uint32_t kGrids = VoxelNumbers::kGrids;
constexpr std::uint32_t kGridStep = 21;
constexpr VoxelKey kKeys = VoxelKey{1} << 63U;
constexpr VoxelKey kKeyStep = kKeys / 2'000;

// Voxels come and go, few or many at once.
TEST(VoxelNumbers, AreThoseOfATreeWhateverIsDropped) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    Random random(seed);
    VoxelNumbers numbers;
    std::map<std::pair<std::uint32_t, VoxelKey>, std::uint32_t> expected;
    for (int round = 0; round < 60; ++round) {
      for (std::uint32_t i = random.Index(1'000); i > 0; --i) {
        const std::uint32_t grid = kGridStep * random.Index(kGrids / kGridStep);
        const VoxelKey key = kKeyStep * random.Index(kKeys / kKeyStep);
        const auto next = static_cast<std::uint32_t>(expected.size());
        ASSERT_EQ(numbers.FindOrAdd(grid, key),
                  expected.emplace(std::make_pair(grid, key), next).first->second);
      }
      const std::uint32_t one_in = 1 + random.Index(40);  // is kept, or is dropped
      const bool are_few = random.Index(2) == 0;
      std::vector<std::uint32_t> moved(expected.size(), VoxelNumbers::kNone);
      std::uint32_t kept = 0;
      for (std::uint32_t& number : moved) {
        if ((random.Index(one_in) == 0) == are_few) number = kept++;
      }
      numbers.Renumber(moved, kept);
      for (auto at = expected.begin(); at != expected.end();) {
        at->second = moved[at->second];
        at = at->second == VoxelNumbers::kNone ? expected.erase(at) : std::next(at);
      }
      ASSERT_EQ(numbers.size(), expected.size());
      for (std::uint32_t grid = 0; grid < kGrids; grid += kGridStep) {
        for (VoxelKey key = 0; key < kKeys; key += kKeyStep) {
          const auto at = expected.find({grid, key});
          ASSERT_EQ(numbers.Find(grid, key),
                    at == expected.end() ? VoxelNumbers::kNone : at->second);
        }
      }
    }
    numbers.Clear();
    EXPECT_EQ(numbers.size(), 0U);
    EXPECT_EQ(numbers.Find(0, 1), VoxelNumbers::kNone);
    EXPECT_EQ(numbers.FindOrAdd(0, 1), 0U);
  }
}

TEST(VoxelNumbers, VisitsEachVoxelOnce) {
  VoxelNumbers numbers;
  std::map<VoxelKey, int> visits;
  numbers.VisitAll([&](std::uint32_t, VoxelKey key) { ++visits[key]; });
  EXPECT_TRUE(visits.empty());
  for (VoxelKey key = 0; key < 1000; ++key) numbers.FindOrAdd(key % VoxelNumbers::kGrids, key);
  numbers.VisitAll([&](std::uint32_t grid, VoxelKey key) {
    EXPECT_EQ(grid, key % VoxelNumbers::kGrids);
    ++visits[key];
  });
  EXPECT_EQ(visits.size(), numbers.size());
  for (const auto& [key, count] : visits) EXPECT_EQ(count, 1);
}

}  // namespace
}  // namespace unlidar
