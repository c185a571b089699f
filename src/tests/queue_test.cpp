#include "base/queue.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

TEST(Queue, HoldsWhatADequeHolds) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Random random(seed);
    Queue<int> queue;
    std::deque<int> expected;
    for (int i = 0; i < 3'000; ++i) {
      const std::size_t size = expected.size();
      const std::uint32_t what = random.Index(20);
      if (what < 9) {
        queue.push_back(i);
        expected.push_back(i);
      } else if (what == 9) {
        const auto at = static_cast<std::ptrdiff_t>(random.Index(size + 1));
        queue.Insert(queue.begin() + at, i);
        expected.insert(expected.begin() + at, i);
      } else if (size > 0) {
        queue.pop_front();
        expected.pop_front();
      }
      if (i % 700 == 0) queue.ShrinkToFit();
      ASSERT_EQ(std::deque<int>(queue.begin(), queue.end()), expected) << seed << ' ' << i;
      ASSERT_EQ(queue.size(), expected.size());
      ASSERT_EQ(queue.empty(), expected.empty());
    }
  }
}

// However many pass, there is room for three times as many as are in it at once.
TEST(Queue, WhatGoesLeavesItsMemoryToWhatComes) {
  Queue<std::vector<int>> queue;
  constexpr std::size_t kAtOnce = 5;
  std::size_t num_new = 0;
  for (int i = 0; i < 1'000; ++i) {
    std::vector<int>& value = queue.Append();
    if (value.capacity() == 0) ++num_new;
    value.assign(10, i);
    if (queue.size() > kAtOnce) queue.pop_front();
  }
  EXPECT_LE(num_new, 3 * kAtOnce);
  EXPECT_EQ(queue.front().front(), 1'000 - static_cast<int>(kAtOnce));
}

}  // namespace
}  // namespace unlidar
