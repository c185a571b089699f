// How many allocations a frame takes once a stream runs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <new>
#include <utility>
#include <variant>
#include <vector>

#include "tests/synthetic_recording.hpp"
#include "unlidar/engine.hpp"

namespace {

std::size_t num_allocations = 0;

}  // namespace

#ifndef UNLIDAR_SANITIZED
void* operator new(std::size_t size) {
  ++num_allocations;
  void* const memory = std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
#endif

namespace unlidar {
namespace {

// The budget: a quarter to a third more than what was measured.
constexpr std::size_t kMostOfAKnownScene = 20;
constexpr std::size_t kMostWithADrone = 4800;  // nearly all in Ceres: a fit for each row

constexpr int kWarmUpFrames = 120;
constexpr int kFrames = 100;

class FrameAllocationsTest : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef UNLIDAR_SANITIZED
    GTEST_SKIP() << "the sanitizer has allocations of its own";
#endif
  }
};

// Ground and a wall of so many returns, and a drone that circles where it is wanted.
Frame FrameAt(int i, int num_static, bool has_drone, testing::Random* random) {
  Frame frame;
  frame.stamp_ns = testing::kBeginNs + i * testing::kPeriodNs;
  for (int k = 0; k < num_static; ++k) {
    const bool is_ground = k % 4 != 0;
    frame.points_m.push_back((is_ground ? random->InBox({-20, -20, -2.02}, {20, 20, -1.98})
                                        : random->InBox({21, -10, -2}, {21.05, 10, 4}))
                                 .cast<float>());
  }
  const double angle = 0.4 * i * testing::kPeriodS;
  const Eigen::Vector3d drone_m(8.0 * std::cos(angle), 8.0 * std::sin(angle), 9.0);
  for (int k = 0; has_drone && k < 6; ++k) {
    frame.points_m.push_back((drone_m + random->NormalVector(0.08)).cast<float>());
  }
  return frame;
}

struct Cost {
  std::size_t allocations = 0;  // median of the frames after the warm-up
  int rows = 0;
};

Cost CostOfAFrame(int num_static, bool has_drone) {
  Cost cost;
  Engine engine(Config(), {"lidar"}, [&](const EngineEvent& event) {
    cost.rows += std::holds_alternative<RowGiven>(event) ? 1 : 0;
  });
  testing::Random random(1);
  std::vector<std::size_t> counts;
  for (int i = 0; i < kWarmUpFrames + kFrames; ++i) {
    Frame frame = FrameAt(i, num_static, has_drone, &random);
    const std::size_t before = num_allocations;
    engine.Add(std::move(frame));
    const std::size_t count = num_allocations - before;
    if (i >= kWarmUpFrames) counts.push_back(count);
  }
  std::nth_element(counts.begin(), counts.begin() + kFrames / 2, counts.end());
  cost.allocations = counts[kFrames / 2];
  return cost;
}

TEST_F(FrameAllocationsTest, OfAKnownSceneAreFewAndNoneIsForAReturn) {
  const Cost sparse = CostOfAFrame(300, false);
  const Cost dense = CostOfAFrame(12'000, false);
  EXPECT_EQ(sparse.rows, 0);
  EXPECT_LE(sparse.allocations, kMostOfAKnownScene);
  EXPECT_EQ(dense.allocations, sparse.allocations);
}

TEST_F(FrameAllocationsTest, OfADroneAreThoseOfTheFitOfItsRow) {
  const Cost sparse = CostOfAFrame(300, true);
  const Cost dense = CostOfAFrame(3'000, true);
  EXPECT_GT(sparse.rows, kFrames);
  EXPECT_LE(sparse.allocations, kMostWithADrone);
  EXPECT_LE(dense.allocations, kMostWithADrone);
}

}  // namespace
}  // namespace unlidar
