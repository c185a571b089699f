#include "scene/recent_bins.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

constexpr int kWindow = RecentBins::kWindow;

using Ages = std::set<int>;

// None, few, many or all of the window.
Ages DrawnAges(testing::Random* random) {
  const double share = std::pow(random->Uniform(-0.2, 1.1), 3);
  Ages ages;
  for (int age = 0; age < kWindow; ++age) {
    if (random->Uniform(0.0, 1.0) < share) ages.insert(age);
  }
  return ages;
}

RecentBins BinsOf(const Ages& ages) {
  RecentBins bins;
  for (const int age : ages) bins.Insert(age);
  return bins;
}

Ages AgesOf(const RecentBins& bins) {
  Ages ages;
  for (int age = 0; age < kWindow; ++age) {
    if (bins.Contains(age)) ages.insert(age);
  }
  return ages;
}

class RecentBinsTest : public ::testing::Test {
 protected:
  testing::Random random_{1};
};

TEST_F(RecentBinsTest, AreTheSetOfWhatWasInserted) {
  EXPECT_TRUE(RecentBins().IsEmpty());
  EXPECT_EQ(RecentBins().Youngest(), kWindow);
  for (int trial = 0; trial < 200; ++trial) {
    const Ages ages = DrawnAges(&random_);
    const RecentBins bins = BinsOf(ages);
    EXPECT_EQ(AgesOf(bins), ages);
    EXPECT_EQ(bins.Size(), static_cast<int>(ages.size()));
    EXPECT_EQ(bins.IsEmpty(), ages.empty());
    EXPECT_EQ(bins.Youngest(), ages.empty() ? kWindow : *ages.begin());
  }
}

TEST_F(RecentBinsTest, AgeOutOfTheWindow) {
  for (int passed = 0; passed <= 300; ++passed) {
    const Ages ages = DrawnAges(&random_);
    Ages expected;
    for (const int age : ages) {
      if (age + passed < kWindow) expected.insert(age + passed);
    }
    RecentBins bins = BinsOf(ages);
    bins.Age(passed);
    EXPECT_EQ(AgesOf(bins), expected) << passed;
  }
  RecentBins bins = BinsOf({0, 100});
  bins.Age(1'000'000'000'000);
  EXPECT_TRUE(bins.IsEmpty());
}

TEST_F(RecentBinsTest, UniteAndIntersect) {
  for (int trial = 0; trial < 200; ++trial) {
    const Ages a = DrawnAges(&random_);
    const Ages b = DrawnAges(&random_);
    Ages either = a;
    either.insert(b.begin(), b.end());
    Ages both;
    std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::inserter(both, both.end()));
    RecentBins united = BinsOf(a);
    united |= BinsOf(b);
    EXPECT_EQ(AgesOf(united), either);
    EXPECT_EQ(AgesOf(BinsOf(a) & BinsOf(b)), both);
  }
}

// The range may be empty, end beyond the window or lie behind it.
TEST_F(RecentBinsTest, CountThoseOutsideARange) {
  for (int trial = 0; trial < 2000; ++trial) {
    const Ages ages = DrawnAges(&random_);
    const int youngest = static_cast<int>(random_.Index(kWindow + 1));
    const int oldest = youngest - 1 + static_cast<int>(random_.Index(kWindow + 2));
    const auto num_outside = std::count_if(ages.begin(), ages.end(),
                                           [&](int age) { return age < youngest || age > oldest; });
    EXPECT_EQ(BinsOf(ages).SizeOutside(youngest, oldest), num_outside) << youngest << ' ' << oldest;
  }
}

}  // namespace
}  // namespace unlidar
