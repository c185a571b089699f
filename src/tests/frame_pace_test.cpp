#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "io/arrival.hpp"

namespace unlidar {
namespace {

using std::chrono::milliseconds;
using Time = FramePace::Clock::time_point;

constexpr milliseconds kPatience(2000);

struct Work {
  std::vector<int> kept;  // numbers of the frames that were worked off
  milliseconds longest_wait{0};
};

// Frames come every `period` and take `work` each; `backlog` of them are there at the beginning.
Work Simulate(milliseconds period, milliseconds work, int frames, int backlog = 0) {
  FramePace pace(kPatience);
  Work run;
  Time now{};
  for (int i = 0; i < frames; ++i) {
    const Time came = Time{} + std::max(0, i - backlog + 1) * period;
    now = std::max(now, came);
    const bool was_there = i < backlog;
    const auto waited = now - came;
    if (!was_there) {
      run.longest_wait =
          std::max(run.longest_wait, std::chrono::duration_cast<milliseconds>(waited));
    }
    if (!pace.Keeps(0, was_there ? std::nullopt : std::make_optional(waited), now)) continue;
    run.kept.push_back(i);
    now += work;
  }
  return run;
}

TEST(FramePace, KeepsEveryFrameThatCanBeWorkedOff) {
  EXPECT_EQ(Simulate(milliseconds(100), milliseconds(90), 1000).kept.size(), 1000U);
}

TEST(FramePace, ABurstShorterThanThePatienceIsWorkedOffInWhole) {
  EXPECT_EQ(Simulate(milliseconds(0), milliseconds(1), 1500).kept.size(), 1500U);
}

TEST(FramePace, ABacklogIsWorkedOffInWholeWhileOthersCome) {
  // 100 s of work in the backlog: the first new frames wait for as long.
  EXPECT_EQ(Simulate(milliseconds(100), milliseconds(50), 6000, 2000).kept.size(), 6000U);
}

TEST(FramePace, LeavesFramesOutEvenlyAndNeverFallsFarBehind) {
  for (const int load : {2, 3, 10, 50}) {
    const Work run = Simulate(milliseconds(10), milliseconds(10 * load), 60'000);
    // It takes half a patience to find that half of the frames are still too many.
    const int halvings = static_cast<int>(std::ceil(std::log2(load))) + 1;
    EXPECT_LT(run.longest_wait, kPatience + halvings * kPatience / 2 + milliseconds(20 * load))
        << load;
    EXPECT_GT(run.kept.size(), 60'000U / static_cast<unsigned>(load) / 3) << load;
    int longest_gap = 0;
    for (std::size_t i = 1; i < run.kept.size(); ++i) {
      longest_gap = std::max(longest_gap, run.kept[i] - run.kept[i - 1]);
    }
    EXPECT_LT(longest_gap, 8 * load) << load;
  }
}

TEST(FramePace, EverySensorLosesTheSameShare) {
  FramePace pace(kPatience);
  Time now{};
  std::vector<int> kept(2);
  for (int i = 0; i < 4000; ++i) {
    now += milliseconds(1);
    const std::size_t sensor = i % 3 == 0 ? 1 : 0;
    kept[sensor] += pace.Keeps(sensor, i == 0 ? milliseconds(0) : milliseconds(5000), now) ? 1 : 0;
  }
  EXPECT_GT(pace.one_in(), 1U);
  EXPECT_NEAR(kept[0], 2.0 * kept[1], 4.0);
}

TEST(FramePace, KeepsEveryFrameAgainOnceItKeepsUp) {
  FramePace pace(kPatience);
  Time now{};
  pace.Keeps(0, milliseconds(0), now);
  for (int i = 0; i < 10'000; ++i) pace.Keeps(0, milliseconds(3000), now += milliseconds(1));
  EXPECT_GT(pace.one_in(), 1U);
  for (int i = 0; i < 20'000; ++i) pace.Keeps(0, milliseconds(1), now += milliseconds(1));
  EXPECT_EQ(pace.one_in(), 1U);
}

}  // namespace
}  // namespace unlidar
