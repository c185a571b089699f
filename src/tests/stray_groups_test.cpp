#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include "scene/linkage.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

constexpr double kRadius_m = 0.5;
const double kReach_m3 = 4.0 / 3.0 * M_PI * std::pow(kRadius_m, 3);

TEST(StrayGroups, EachStrayIsOfOneGroup) {
  for (const double num_near : {0.01, 0.3, 0.7}) {
    const double rate = num_near / kReach_m3;
    double sum = 0.0;
    for (int n = 1; n < 2000; ++n) sum += n * StrayGroupRate(rate, kRadius_m, n);
    EXPECT_NEAR(sum, rate, 1e-6 * rate) << num_near;
  }
}

TEST(StrayGroups, WhereChainsNeverEndAnyGroupMayBeOfStrays) {
  EXPECT_TRUE(std::isinf(StrayGroupRate(1.01 / kReach_m3, kRadius_m, 20.0)));
}

TEST(StrayGroups, ThoseThatAreRareAreAsManyAsTheirSizesTogether) {
  constexpr double kMost = 0.05;
  for (const double num_near : {0.01, 0.3, 0.7}) {
    const double rate = num_near / kReach_m3;
    double sum = 0.0;
    for (int n = 1; n < 2000; ++n) {
      const double of_size = StrayGroupRate(rate, kRadius_m, n);
      sum += of_size < kMost ? of_size : 0.0;
    }
    EXPECT_NEAR(RareStrayGroupRate(rate, kRadius_m, kMost), sum, 1e-6 * rate) << num_near;
  }
  EXPECT_EQ(RareStrayGroupRate(1.01 / kReach_m3, kRadius_m, kMost), 0.0);  // any is frequent
}

TEST(StrayGroups, ManyStraysGroupNoMoreOftenThanSaid) {
  constexpr float kEdge_m = 40.0F;
  const double rate = 0.3 / kReach_m3;
  testing::Random random(1);
  std::vector<Eigen::Vector3f> points_m;
  for (double n = rate * std::pow(static_cast<double>(kEdge_m), 3); n > 0.0; n -= 1.0) {
    const auto at = [&] { return static_cast<float>(random.Uniform(0.0, 1.0)) * kEdge_m; };
    points_m.emplace_back(at(), at(), at());
  }
  std::vector<std::uint32_t> returns(points_m.size());
  std::iota(returns.begin(), returns.end(), 0U);
  Linker linker;
  linker.Link(points_m, returns, {kRadius_m, 0.0});
  for (const std::size_t size : {4U, 6U, 8U}) {
    double num_groups = 0.0;
    for (std::size_t g = 0; g < linker.size(); ++g) num_groups += linker[g].size() == size ? 1 : 0;
    const double expected = StrayGroupRate(rate, kRadius_m, static_cast<double>(size)) *
                            std::pow(static_cast<double>(kEdge_m), 3);
    EXPECT_LT(num_groups, expected + 3.0 * std::sqrt(expected)) << size;
    EXPECT_GT(num_groups, 0.05 * expected - 3.0) << size;
  }
}

}  // namespace
}  // namespace unlidar
