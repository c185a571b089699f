// How much memory and time the whole way from frames to rows takes.
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <new>
#include <string>
#include <vector>

#include "io/pcd.hpp"
#include "recording/pipeline.hpp"
#include "tests/synthetic_recording.hpp"
#include "tests/temporary_folder.hpp"

namespace {

std::size_t bytes_now = 0;
std::size_t bytes_at_most = 0;

}  // namespace

#ifndef UNLIDAR_SANITIZED
static void Free(void* memory) {
  bytes_now -= malloc_usable_size(memory);
  std::free(memory);
}

void* operator new(std::size_t size) {
  void* const memory = std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  bytes_now += malloc_usable_size(memory);
  bytes_at_most = std::max(bytes_at_most, bytes_now);
  return memory;
}
void operator delete(void* memory) noexcept { Free(memory); }
void operator delete(void* memory, std::size_t) noexcept { Free(memory); }
#endif

namespace unlidar {
namespace {

struct Cost {
  double megabytes = 0.0;
  double cpu_s = 0.0;
};

class CostTest : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef UNLIDAR_SANITIZED
    GTEST_SKIP() << "the sanitizer takes memory and time";
#endif
  }
};

// Of tracking so many frames, filled by `returns(i)`.
Cost CostOf(int num_frames, double period_s,
            const std::function<std::vector<Eigen::Vector3f>(int)>& returns) {
  const testing::TemporaryFolder folder;
  for (int i = 0; i < num_frames; ++i) {
    folder.Write(std::to_string(1.6e9 + period_s * i) + ".pcd", BinaryPcd(returns(i)));
  }
  PipelineRequest request;
  request.sources = {{"lidar", folder.path()}};
  const std::size_t before = bytes_at_most = bytes_now;
  const std::clock_t begin = std::clock();
  RunPipeline(request, Config(), [](const StageTime&, const std::string&) {});
  return {static_cast<double>(bytes_at_most - before) / 1e6,
          static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC};
}

std::vector<Eigen::Vector3f> Strays(testing::Random* random, int count) {
  std::vector<Eigen::Vector3f> points_m;
  for (int i = 0; i < count; ++i) {
    points_m.push_back(random->InBox({-30, -30, -2}, {30, 30, 30}).cast<float>());
  }
  return points_m;
}

TEST_F(CostTest, FollowsTheReturnsNotTheStamps) {
  const auto cost_at = [](double period_s) {
    testing::Random random(1);
    return CostOf(120, period_s, [&](int) { return Strays(&random, 20); });
  };
  const Cost usual = cost_at(0.1);
  for (const double period_s : {1.0, 60.0, 3600.0, 86400.0}) {
    const Cost cost = cost_at(period_s);
    EXPECT_LT(cost.megabytes, 1.5 * usual.megabytes) << period_s;
    EXPECT_LT(cost.cpu_s, 2.0 * usual.cpu_s + 0.2) << period_s;
  }
}

// No table has a row for each place and a column for each time bin.
TEST_F(CostTest, FollowsTheReturnsNotTheFramesTheyComeIn) {
  const auto cost_of = [](int num_frames) {
    testing::Random random(2);
    return CostOf(num_frames, 0.5, [&](int) { return Strays(&random, 6000 / num_frames); });
  };
  const Cost few = cost_of(60);
  const Cost many = cost_of(1200);
  EXPECT_LT(many.megabytes, 1.5 * few.megabytes);
  EXPECT_LT(many.cpu_s, 3.0 * few.cpu_s + 0.2);
}

}  // namespace
}  // namespace unlidar
