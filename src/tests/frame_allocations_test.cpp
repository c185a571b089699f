// Once a stream runs a frame allocates nothing: neither one in which a drone flies, nor one at
// which the scene is fitted anew.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
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

// Longer than anything is remembered: 128 s of occupancy.
constexpr int kWarmUpFrames = 3'000;
// Of two sensors, 15 s of both: at least one refit of the scene is among them, which is one every
// 10 s, and several times what is old is forgotten.
constexpr int kFrames = 300;
constexpr int kSensors = 2;

class FrameAllocationsTest : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef UNLIDAR_SANITIZED
    GTEST_SKIP() << "the sanitizer has allocations of its own";
#endif
  }
};

// Ground and a wall of about so many returns, and a drone that circles where it is wanted. Frames
// differ in size, their stamps jitter, and every second sensor tells when each return was measured.
Frame FrameAt(int i, int num_static, bool has_drone, testing::Random* random) {
  Frame frame;
  frame.sensor = static_cast<std::uint32_t>(i % kSensors);
  frame.stamp_ns = testing::kBeginNs + i * testing::kPeriodNs / kSensors +
                   static_cast<TimeNs>(random->Index(2'000'000));
  const auto spread = static_cast<std::size_t>(num_static / 10);
  const int size = num_static - num_static / 20 + static_cast<int>(random->Index(spread));
  for (int k = 0; k < size; ++k) {
    const bool is_ground = k % 4 != 0;
    frame.points_m.push_back((is_ground ? random->InBox({-20, -20, -2.02}, {20, 20, -1.98})
                                        : random->InBox({21, -10, -2}, {21.05, 10, 4}))
                                 .cast<float>());
  }
  const double angle = 0.4 * i * testing::kPeriodS / kSensors;
  const Eigen::Vector3d drone_m(8.0 * std::cos(angle), 8.0 * std::sin(angle), 9.0);
  for (int k = 0; has_drone && k < 6; ++k) {
    frame.points_m.push_back((drone_m + random->NormalVector(0.08)).cast<float>());
  }
  if (frame.sensor == 1) frame.offsets_ns.assign(frame.points_m.size(), testing::kPeriodNs / 2);
  return frame;
}

struct Cost {
  std::size_t allocations = 0;  // after the warm-up, of all frames
  int rows = 0;                 // likewise
};

Cost CostOfFrames(int num_static, bool has_drone) {
  Cost cost;
  Engine engine(Config(), {"the_sensor_on_the_roof", "the_sensor_on_the_mast"},
                [&](const EngineEvent& event) {
                  cost.rows += std::holds_alternative<RowGiven>(event) ? 1 : 0;
                });
  testing::Random random(1);
  for (int i = 0; i < kWarmUpFrames + kFrames; ++i) {
    Frame frame = FrameAt(i, num_static, has_drone, &random);
    if (i == kWarmUpFrames) cost = Cost();
    const std::size_t before = num_allocations;
    engine.Add(std::move(frame));
    cost.allocations += num_allocations - before;
  }
  return cost;
}

TEST_F(FrameAllocationsTest, OfAKnownSceneAreNone) {
  for (const int num_static : {300, 1'500}) {
    const Cost cost = CostOfFrames(num_static, false);
    EXPECT_EQ(cost.rows, 0);
    EXPECT_EQ(cost.allocations, 0U) << num_static;
  }
}

TEST_F(FrameAllocationsTest, OfADroneThatFliesThereAreNone) {
  for (const int num_static : {300, 1'500}) {
    const Cost cost = CostOfFrames(num_static, true);
    EXPECT_GE(cost.rows, kFrames / kSensors - 2);
    EXPECT_EQ(cost.allocations, 0U) << num_static;
  }
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
  EXPECT_GT(trajectory.minimum.iterations, 3);
}

}  // namespace
}  // namespace unlidar
