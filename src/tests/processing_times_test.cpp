#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "app/summary.hpp"

namespace unlidar {
namespace {

TEST(FrameTimesTest, AQuantileIsThatOfTheSortedTimesWithinTwoPerCent) {
  std::mt19937_64 generator(1);
  std::lognormal_distribution<double> seconds(std::log(2e-3), 2.0);
  for (const std::size_t size : {1U, 2U, 3U, 100U, 5000U}) {
    ProcessingTimes times;
    std::vector<double> sorted(size);
    for (double& time_s : sorted) times.Add(time_s = seconds(generator));
    std::sort(sorted.begin(), sorted.end());
    for (const double share : {0.001, 0.25, 0.5, 0.9, 0.99, 1.0}) {
      const double rank = std::ceil(share * static_cast<double>(size));
      const double truth_s = sorted[static_cast<std::size_t>(rank) - 1];
      EXPECT_GE(times.Quantile(share), truth_s * (1.0 - 1e-9)) << size << " " << share;
      EXPECT_LE(times.Quantile(share), truth_s * 1.02 + 1e-6) << size << " " << share;
    }
    EXPECT_EQ(times.max_s(), sorted.back());
  }
}

TEST(FrameTimesTest, NothingAndTheExtremesHaveQuantilesToo) {
  EXPECT_EQ(ProcessingTimes().Quantile(0.5), 0.0);
  ProcessingTimes times;
  times.Add(0.0);
  EXPECT_EQ(times.Quantile(0.5), 0.0);
  times.Add(1e9);
  EXPECT_EQ(times.Quantile(1.0), 1e9);
}

TEST(FrameTimesTest, TheClockOfTheThreadGoesOnWithItsWork) {
  const double begin_s = ThreadCpuSeconds();
  double last_s = begin_s;
  while (last_s < begin_s + 1e-3) {
    const double now_s = ThreadCpuSeconds();
    ASSERT_GE(now_s, last_s);
    last_s = now_s;
  }
}

}  // namespace
}  // namespace unlidar
