#include "base/block_queue.hpp"

#include <gtest/gtest.h>

#include <deque>

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
    for (std::size_t k = 0; k < queue.size(); ++k) ASSERT_EQ(queue[k], expected[k]);
  }
}

TEST(BlockQueue, FindsTheFirstOfThoseThatAreNotBefore) {
  BlockQueue<int> queue;
  for (int i = 0; i < 3'000; ++i) queue.push_back(i);
  queue.DropFirst(700);
  for (const int value : {700, 701, 2'345, 2'999, 3'000}) {
    const auto is_before = [&](int other) { return other < value; };
    EXPECT_EQ(queue.PartitionPoint(is_before), static_cast<std::size_t>(value - 700));
  }
  EXPECT_EQ(queue.front(), 700);
}

TEST(BlockQueue, KeepsWhatIsBeforeAnEnd) {
  BlockQueue<int> queue;
  for (int i = 0; i < 3'000; ++i) queue.push_back(i);
  queue.DropFirst(100);
  queue.Truncate(700);
  ASSERT_EQ(queue.size(), 700U);
  EXPECT_EQ(queue[699], 799);
  queue[0] = -1;
  queue.push_back(5);
  EXPECT_EQ(queue.front(), -1);
  EXPECT_EQ(queue[700], 5);
  EXPECT_GE(queue.capacity(), queue.size());
}

}  // namespace
}  // namespace unlidar
