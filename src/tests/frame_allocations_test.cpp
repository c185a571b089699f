// How many allocations a frame takes once a stream runs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <variant>
#include <vector>

#include "tests/synthetic_recording.hpp"
#include "trajectory/trajectory_fitter.hpp"
#include "unlidar/engine.hpp"

namespace {

std::size_t num_allocations = 0;

}  // namespace

#ifndef UNLIDAR_SANITIZED
// All that is allocated, by whichever name and in whichever library, goes through one of these.
extern "C" {
// NOLINTBEGIN(clang-diagnostic-reserved-identifier): of glibc
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t n, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
// NOLINTEND(clang-diagnostic-reserved-identifier)

void* malloc(std::size_t size) {
  ++num_allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t n, std::size_t size) {
  ++num_allocations;
  return __libc_calloc(n, size);
}
void* realloc(void* memory, std::size_t size) {
  ++num_allocations;
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ++num_allocations;
  return __libc_memalign(alignment, size);
}
}
#endif

namespace unlidar {
namespace {

// The budget of nine frames of ten: a third more than what was measured, 9 and 21. What is left is
// what a frame brings and hands on itself: its name, points and times, its places in the queues,
// and for each plot the list of its returns. The others refit the scene, or let a table grow.
constexpr std::size_t kMostOfAKnownScene = 12;
constexpr std::size_t kMostWithADrone = 28;

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
  std::size_t allocations = 0;  // of nine frames of ten after the warm-up, at most
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
  constexpr int kNineOfTen = kFrames * 9 / 10;
  std::nth_element(counts.begin(), counts.begin() + kNineOfTen, counts.end());
  cost.allocations = counts[kNineOfTen];
  return cost;
}

TEST_F(FrameAllocationsTest, OfAKnownSceneAreFewAndNoneIsForAReturn) {
  const Cost sparse = CostOfAFrame(300, false);
  const Cost dense = CostOfAFrame(12'000, false);
  EXPECT_EQ(sparse.rows, 0);
  EXPECT_LE(sparse.allocations, kMostOfAKnownScene);
  EXPECT_LE(dense.allocations, kMostOfAKnownScene);
}

TEST_F(FrameAllocationsTest, OfADroneAreFewAndNoneIsForTheFitOfItsRow) {
  const Cost sparse = CostOfAFrame(300, true);
  const Cost dense = CostOfAFrame(3'000, true);
  EXPECT_GT(sparse.rows, kFrames);
  EXPECT_LE(sparse.allocations, kMostWithADrone);
  EXPECT_LE(dense.allocations, kMostWithADrone);
}

TEST_F(FrameAllocationsTest, OfAFitAreNoneAfterOneAsLong) {
  testing::Random random(2);
  std::vector<Measurement> measurements;
  for (int i = 0; i < 60; ++i) {
    Measurement m;
    m.time_ns = testing::kBeginNs + i * testing::kPeriodNs;
    m.position_m = Eigen::Vector3d(0.5 * i, 0.01 * i * i, 10.0) + random.NormalVector(0.1);
    m.covariance_m2 *= 0.01;
    if (i % 9 == 4) m.position_m += random.NormalVector(0.5);  // so that the loss has to bend
    measurements.push_back(m);
  }
  TrajectoryFitter fitter{TrajectoryConfig()};
  Trajectory trajectory;
  fitter.Fit(measurements, trajectory);
  const std::size_t before = num_allocations;
  fitter.Fit(measurements, trajectory);
  fitter.Refit(measurements, trajectory.scales, trajectory);
  EXPECT_EQ(num_allocations, before);
  EXPECT_GT(trajectory.iterations, 3);
}

}  // namespace
}  // namespace unlidar
