#include "app/returns_view.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <vector>

namespace unlidar {
namespace {

using Points = std::vector<Eigen::Vector3f>;
using Cell = std::array<std::int64_t, 3>;

// A ground that is seen from nearby, dense at the sensor, and a few lone returns in the sky.
Points Scene(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> angle(0.0F, 6.2831853F);
  std::exponential_distribution<float> range(0.1F);
  std::normal_distribution<float> noise(0.0F, 0.02F);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    const float a = angle(random);
    const float r = 2.0F + range(random);
    points.emplace_back(r * std::cos(a), r * std::sin(a), noise(random) - 1.5F);
  }
  points.emplace_back(60.0F, -20.0F, 35.0F);
  points.emplace_back(-180.0F, 90.0F, 80.0F);
  std::shuffle(points.begin(), points.end(), random);
  return points;
}

Cell CellOf(const Eigen::Vector3f& point, double edge_m) {
  Cell cell{};
  for (int axis = 0; axis < 3; ++axis) {
    cell[static_cast<std::size_t>(axis)] =
        static_cast<std::int64_t>(std::floor(double{point[axis]} / edge_m));
  }
  return cell;
}

std::set<Cell> Occupied(const Points& points, const std::vector<std::uint32_t>& indices,
                        double edge_m) {
  std::set<Cell> cells;
  for (const std::uint32_t i : indices) cells.insert(CellOf(points[i], edge_m));
  return cells;
}

std::vector<std::uint32_t> All(const Points& points) {
  std::vector<std::uint32_t> indices(points.size());
  for (std::uint32_t i = 0; i < indices.size(); ++i) indices[i] = i;
  return indices;
}

// Steps from base64, by a table: an oracle for the writer.
std::vector<int> Decoded(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<unsigned> bytes;
  for (std::size_t i = 0; i < text.size(); i += 4) {
    std::size_t four = 0;
    for (std::size_t j = 0; j < 4; ++j) four = four * 64 + digits.find(text[i + j]);
    for (const int shift : {16, 8, 0}) bytes.push_back((four >> shift) & 255U);
  }
  std::vector<int> steps;
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    const int value = static_cast<int>(bytes[i] + 256 * bytes[i + 1]);
    steps.push_back(value < 32768 ? value : value - 65536);
  }
  return steps;
}

class Thinning : public ::testing::TestWithParam<std::size_t> {};

TEST_P(Thinning, KeepsOneOfEachVoxelOfTheFinestEdgeThatFits) {
  const std::size_t most = GetParam();
  for (const unsigned seed : {1U, 2U, 3U}) {
    const Points points = Scene(5000, seed);
    const std::vector<std::uint32_t> kept = ThinnedReturns(points, most);
    ASSERT_LE(kept.size(), most);
    ASSERT_FALSE(kept.empty());
    ASSERT_LT(kept.back(), points.size());
    // Ascending: each at most once.
    ASSERT_TRUE(std::is_sorted(kept.begin(), kept.end(), std::less_equal<>()));
    double edge_m = kFinestViewVoxelM;
    while (Occupied(points, All(points), edge_m).size() > most) edge_m *= 2.0;
    EXPECT_EQ(Occupied(points, kept, edge_m), Occupied(points, All(points), edge_m));
    EXPECT_EQ(ThinnedReturns(points, most), kept);
  }
}

INSTANTIATE_TEST_SUITE_P(Limits, Thinning, ::testing::Values(8, 100, 2000, 4990));

TEST(ThinnedReturns, FillsTheRoomThatItHas) {
  const Points points = Scene(20'000, 4);
  EXPECT_EQ(ThinnedReturns(points, 2000).size(), 2000U);
}

TEST(ThinnedReturns, KeepsLoneReturnsFarAway) {
  const Points points = Scene(20'000, 5);
  const std::vector<std::uint32_t> kept = ThinnedReturns(points, 500);
  const auto is_lone = [&](std::uint32_t i) { return points[i].z() > 10.0F; };
  EXPECT_EQ(std::count_if(kept.begin(), kept.end(), is_lone), 2);
}

TEST(ThinnedReturns, LeavesAFrameThatFitsAsItIs) {
  const Points points = Scene(98, 6);
  EXPECT_EQ(ThinnedReturns(points, 100), All(points));
  EXPECT_TRUE(ThinnedReturns({}, 100).empty());
}

TEST(ThinnedReturns, LeavesOutWhatNoViewHolds) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Points points = {{1.0F, 2.0F, 3.0F},
                         {nan, 0.0F, 0.0F},
                         {0.0F, 1e30F, 0.0F},
                         {0.0F, 0.0F, -kMaxViewM},
                         {0.0F, nan, 1.0F}};
  EXPECT_EQ(ThinnedReturns(points, 10), (std::vector<std::uint32_t>{0, 3}));
  EXPECT_EQ(ThinnedReturns(points, 1).size(), 1U);
}

TEST(TextOfReturns, IsWithinHalfAStepAndTheStepTheSmallestThatHoldsAll) {
  for (const float scale : {0.1F, 1.0F, 3.0F, 30.0F}) {
    Points points = Scene(500, 7);
    for (Eigen::Vector3f& point : points) point *= scale;
    const ReturnsText text = TextOfReturns(points, All(points));
    const std::vector<int> steps = Decoded(text.xyz);
    ASSERT_EQ(steps.size(), 3 * points.size());
    int largest = 0;
    for (std::size_t i = 0; i < steps.size(); ++i) {
      EXPECT_NEAR(steps[i] * text.step_m, points[i / 3][static_cast<int>(i % 3)],
                  0.5 * text.step_m + 1e-4);
      largest = std::max(largest, std::abs(steps[i]));
    }
    EXPECT_GE(largest, text.step_m > 0.01 ? 16'383 : 0);
  }
  EXPECT_EQ(TextOfReturns({}, {}).xyz, "");
  EXPECT_LE(TextOfReturns({Eigen::Vector3f(kMaxViewM, 0.0F, 0.0F)}, {0}).step_m, 1.0);
}

TEST(ViewPace, IsFiveASecondWhereStampsJitter) {
  std::mt19937 random(8);
  std::uniform_int_distribution<TimeNs> jitter(-5'000'000, 5'000'000);
  for (const TimeNs period_ns : {TimeNs{20'000'000}, TimeNs{50'000'000}, TimeNs{100'000'000}}) {
    ViewPace pace;
    int chosen = 0;
    for (TimeNs time_ns = 0; time_ns < 20'000'000'000; time_ns += period_ns) {
      if (pace.IsDue(time_ns + jitter(random))) ++chosen;
    }
    EXPECT_NEAR(chosen, 100, 3) << period_ns;
  }
}

TEST(ViewPace, GoesOnAfterAPauseAndAfterTheClockWasSetBack) {
  ViewPace pace;
  constexpr TimeNs kSecondNs = 1'000'000'000;
  EXPECT_TRUE(pace.IsDue(100 * kSecondNs));
  EXPECT_FALSE(pace.IsDue(100 * kSecondNs + 100'000'000));
  EXPECT_TRUE(pace.IsDue(200 * kSecondNs));  // nothing is made up for
  EXPECT_FALSE(pace.IsDue(200 * kSecondNs + 100'000'000));
  EXPECT_TRUE(pace.IsDue(50 * kSecondNs));
  EXPECT_FALSE(pace.IsDue(50 * kSecondNs + 100'000'000));
}

}  // namespace
}  // namespace unlidar
