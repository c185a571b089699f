#include "base/block_queue.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <iterator>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

TEST(BlockQueue, HoldsWhatADequeDoes) {
  testing::Random random(1);
  BlockQueue<int> queue;
  std::deque<int> expected;
  for (int i = 0; i < 200; ++i) {
    for (std::size_t k = random.Index(900); k > 0; --k) {
      expected.push_back(static_cast<int>(k) * i);
      queue.push_back(expected.back());
    }
    const std::size_t gone = i % 50 == 49 ? expected.size() : random.Index(expected.size() + 1);
    expected.erase(expected.begin(), expected.begin() + static_cast<std::ptrdiff_t>(gone));
    queue.DropFirst(gone);
    ASSERT_EQ(queue.size(), expected.size());
    EXPECT_EQ(queue.empty(), expected.empty());
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), queue.begin()));
  }
}

TEST(BlockQueue, IsSearchedLikeAVector) {
  BlockQueue<int> queue;
  for (int i = 0; i < 3'000; ++i) queue.push_back(i);
  queue.DropFirst(700);
  const auto at =
      std::partition_point(queue.begin(), queue.end(), [](int value) { return value < 2'345; });
  EXPECT_EQ(*at, 2'345);
  EXPECT_EQ(*std::prev(at), 2'344);
  EXPECT_EQ(at - queue.begin(), 2'345 - 700);
  EXPECT_EQ(queue.front(), 700);
}

}  // namespace
}  // namespace unlidar
