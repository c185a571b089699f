#include "base/parallel.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/several_threads.hpp"

namespace unlidar {
namespace {

using testing::Threads;

TEST(ParallelFor, CallsEachOnceWhateverTheNumberOfThreads) {
  for (const int threads : {1, 2, 3, 64}) {
    const Threads several(threads);
    for (const std::size_t count : {0U, 1U, 2U, 1000U}) {
      std::vector<std::atomic<int>> calls(count);
      ParallelFor(count, [&](std::size_t i) { ++calls[i]; });
      for (const std::atomic<int>& number : calls) EXPECT_EQ(number, 1);
    }
  }
}

TEST(ParallelFor, ThrowsWhatTheFirstOfThoseThatFailThrowsAfterAllAreDone) {
  for (const int threads : {1, 4}) {
    const Threads several(threads);
    std::atomic<int> calls{0};
    try {
      ParallelFor(100, [&](std::size_t i) {
        ++calls;
        if (i % 30 == 29) throw std::runtime_error(std::to_string(i));
      });
      FAIL();
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "29");
    }
    EXPECT_EQ(calls, 100);
  }
}

}  // namespace
}  // namespace unlidar
