#include "base/algorithms.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

TEST(SortByGroup, IsAStableSortWithTheBeginOfEachGroup) {
  testing::Random random(1);
  for (const std::uint32_t num_groups : {1U, 2U, 7U, 50U}) {
    for (const std::size_t num_items : {0U, 1U, 30U}) {
      std::vector<std::uint32_t> group_of;
      for (std::size_t i = 0; i < num_items; ++i) {
        group_of.push_back(static_cast<std::uint32_t>(random.Uniform(0.0, num_groups)));
      }
      std::vector<std::size_t> expected(num_items);
      for (std::size_t i = 0; i < num_items; ++i) expected[i] = i;
      std::stable_sort(expected.begin(), expected.end(),
                       [&](std::size_t a, std::size_t b) { return group_of[a] < group_of[b]; });
      std::vector<std::size_t> sorted(num_items);
      std::vector<std::uint32_t> begins;
      SortByGroup(group_of, num_groups, &begins,
                  [&](std::size_t item, std::uint32_t at) { sorted[at] = item; });
      EXPECT_EQ(sorted, expected);
      ASSERT_EQ(begins.size(), num_groups + 1);
      for (std::uint32_t group = 0; group <= num_groups; ++group) {
        EXPECT_EQ(begins[group], std::count_if(group_of.begin(), group_of.end(),
                                               [&](std::uint32_t of) { return of < group; }));
      }
    }
  }
}

}  // namespace
}  // namespace unlidar
