#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "scene/linkage.hpp"
#include "scene/plots.hpp"
#include "tests/draws.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;
using Groups = std::vector<std::vector<std::uint32_t>>;
using Points = std::vector<Eigen::Vector3f>;

std::vector<std::uint32_t> MembersOf(const Linker& linker, std::size_t group) {
  return {linker[group].begin(), linker[group].end()};
}

Groups Link(const Points& points_m, const std::vector<std::uint32_t>& returns,
            const RangeRadius& radius) {
  Linker linker;
  linker.Link(points_m, returns, radius);
  Groups groups;
  for (std::size_t g = 0; g < linker.size(); ++g) groups.push_back(MembersOf(linker, g));
  return groups;
}

// The definition: every return against all that follow it along x within its radius.
Groups LinkByDefinition(const Points& points_m, const std::vector<std::uint32_t>& returns,
                        const RangeRadius& radius) {
  const std::size_t n = returns.size();
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), 0);
  const auto point = [&](std::size_t i) -> const Eigen::Vector3f& { return points_m[returns[i]]; };
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return point(a).x() < point(b).x() || (point(a).x() == point(b).x() && a < b);
  });
  std::vector<std::size_t> parent(n);
  std::iota(parent.begin(), parent.end(), 0);
  const auto find = [&](std::size_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (std::size_t a = 0; a < n; ++a) {
    const std::size_t i = order[a];
    const float reach = static_cast<float>(radius.At(static_cast<double>(point(i).norm())));
    for (std::size_t b = a + 1; b < n && point(order[b]).x() - point(i).x() < reach; ++b) {
      const std::size_t j = order[b];
      if ((point(i) - point(j)).squaredNorm() >= reach * reach) continue;
      const std::size_t p = find(i);
      const std::size_t q = find(j);
      parent[std::max(p, q)] = std::min(p, q);
    }
  }
  Groups groups;
  std::vector<std::size_t> group_of(n, n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t root = find(i);
    if (group_of[root] == n) {
      group_of[root] = groups.size();
      groups.emplace_back();
    }
    groups[group_of[root]].push_back(returns[i]);
  }
  return groups;
}

std::vector<std::uint32_t> AllOf(const Points& points_m) {
  std::vector<std::uint32_t> returns(points_m.size());
  std::iota(returns.begin(), returns.end(), 0U);
  return returns;
}

// Radii as they are set, a constant one, and steep ones, where the order along x tells most.
const std::vector<RangeRadius>& Radii() {
  static const std::vector<RangeRadius> radii = {
      PlotConfig().link, RangeRadius{1.5, 0.02}, {0.5, 0.0}, {0.05, 0.3}, {0.01, 1.0}};
  return radii;
}

// Clumps, strays and copies of both at some range.
Points RandomCloud(Random* random) {
  const double reach_m = std::exp(random->Uniform(0.0, 6.0));
  const double sigma_m = std::exp(random->Uniform(-4.0, 2.0));
  const double spacing_m = random->Uniform(0.0, 1.0) < 0.5 ? 0.0 : 0.25;  // ties
  Points points_m;
  const auto add = [&](Eigen::Vector3d p) {
    if (spacing_m > 0.0) p = spacing_m * (p / spacing_m).array().round().matrix();
    points_m.push_back(p.cast<float>());
  };
  const std::uint32_t num_clumps = 1 + random->Index(12);
  for (std::uint32_t k = 0; k < num_clumps; ++k) {
    const Eigen::Vector3d centre_m = reach_m * random->InBox({-1, -1, -0.2}, {1, 1, 0.2});
    const std::uint32_t size = random->Index(40);
    for (std::uint32_t i = 0; i < size; ++i) add(centre_m + random->NormalVector(sigma_m));
  }
  const std::uint32_t num_strays = random->Index(60);
  for (std::uint32_t i = 0; i < num_strays; ++i) {
    add(reach_m * random->InBox({-1, -1, -0.2}, {1, 1, 0.2}));
  }
  const std::uint32_t num_copies = random->Index(points_m.size() / 2 + 1);
  for (std::uint32_t i = 0; i < num_copies; ++i) {
    points_m.push_back(points_m[random->Index(points_m.size())]);
  }
  return points_m;
}

TEST(Link, IsThatOfItsDefinition) {
  Random random(1);
  std::size_t num_groups = 0;
  std::size_t num_linked = 0;
  for (int trial = 0; trial < testing::Draws(3000); ++trial) {
    const Points points_m = RandomCloud(&random);
    std::vector<std::uint32_t> returns;
    for (const std::uint32_t i : AllOf(points_m)) {
      if (random.Uniform(0.0, 1.0) < 0.9) returns.push_back(i);
    }
    const RangeRadius& radius = Radii()[static_cast<std::size_t>(trial) % Radii().size()];
    const Groups groups = Link(points_m, returns, radius);
    ASSERT_EQ(groups, LinkByDefinition(points_m, returns, radius)) << trial;
    num_groups += groups.size();
    num_linked += returns.size() - groups.size();
  }
  EXPECT_GT(num_groups, testing::Draws(10'000U));
  EXPECT_GT(num_linked, testing::Draws(10'000U));
}

// Pairs at a radius but for the last bits of a float, along the axes and across, at the same x too.
TEST(Link, DecidesPairsOnTheBoundaryAsItsDefinitionDoes) {
  Random random(2);
  for (const RangeRadius& radius : Radii()) {
    int num_linked = 0;
    for (int trial = 0; trial < testing::Draws(4000); ++trial) {
      const Eigen::Vector3f a = random.NormalVector(20.0).cast<float>();
      Eigen::Vector3d step = random.NormalVector(1.0);
      if (trial % 3 == 0) step.x() = 0.0;
      if (trial % 4 == 0) step.y() = step.z() = 0.0;
      if (step.isZero()) continue;
      const double reach_m = radius.At(static_cast<double>(a.norm()));
      Points points_m = {a, (a.cast<double>() + reach_m * step.normalized()).cast<float>()};
      if (trial % 2 == 0) std::swap(points_m[0], points_m[1]);
      const Groups groups = Link(points_m, {0, 1}, radius);
      ASSERT_EQ(groups, LinkByDefinition(points_m, {0, 1}, radius));
      num_linked += groups.size() == 1 ? 1 : 0;
      // Many at each of the two places, in any order.
      for (int copy = 0; copy < 40; ++copy) points_m.push_back(points_m[random.Index(2)]);
      ASSERT_EQ(Link(points_m, AllOf(points_m), radius),
                LinkByDefinition(points_m, AllOf(points_m), radius));
    }
    EXPECT_GT(num_linked, testing::Draws(400));
    EXPECT_LT(num_linked, testing::Draws(3600));
  }
}

TEST(Link, OfNothingIsNothingAndOfOneIsOne) {
  EXPECT_TRUE(Link({}, {}, PlotConfig().link).empty());
  EXPECT_EQ(Link({{1.0F, 2.0F, 3.0F}}, {0}, PlotConfig().link), (Groups{{0}}));
}

// Half a million returns each: pair by pair they would take minutes.
constexpr std::uint32_t kMany = testing::Draws(500'000U);
constexpr RangeRadius kHalfMetre{0.5, 0.0};

// How many groups there are, found in little time.
std::size_t NumGroups(const Points& points_m, const RangeRadius& radius = kHalfMetre) {
  constexpr double kMostCpuS = 40.0;  // enough under a sanitizer
  const std::clock_t begin = std::clock();
  const std::size_t num_groups = Link(points_m, AllOf(points_m), radius).size();
  EXPECT_LT(static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC, kMostCpuS);
  return num_groups;
}

TEST(Link, ManyReturnsOfOnePlaceAreOneGroup) {
  const Points points_m(kMany, {3.0F, 2.0F, 1.0F});
  EXPECT_EQ(NumGroups(points_m), 1U);
}

TEST(Link, ManyReturnsOfOneClumpAreOneGroup) {
  Random random(3);
  Points points_m;
  for (std::uint32_t i = 0; i < kMany; ++i) {
    points_m.push_back(random.InBox({1, 0, 0}, {1.2, 0.2, 0.2}).cast<float>());
  }
  EXPECT_EQ(NumGroups(points_m), 1U);
}

TEST(Link, ManyReturnsOfTwoPlatesAreOneGroupOnlyIfTheyAreNear) {
  for (const float gap_m : {0.499F, 0.501F}) {
    Random random(4);
    Points points_m;
    for (std::uint32_t i = 0; i < kMany / 2; ++i) {
      const Eigen::Vector3d p = random.InBox({0, 0, 0}, {0.25, 0.25, 0});
      points_m.emplace_back(p.cast<float>());
      points_m.emplace_back(p.cast<float>() + Eigen::Vector3f(0.0F, 0.0F, gap_m));
    }
    EXPECT_EQ(NumGroups(points_m), gap_m < 0.5F ? 1U : 2U);
  }
}

// Diagonal plates, so that the boxes about them touch.
TEST(Link, ManyReturnsOfClumpsWithBoxesThatTouchAreAGroupEach) {
  Random random(7);
  Points points_m;
  for (std::uint32_t i = 0; i < kMany / 2; ++i) {
    const Eigen::Vector3d p = random.InBox({0, 0, 0}, {1.0, 1.0, 0});
    points_m.push_back(Eigen::Vector3d(p.x(), p.y(), p.x() + p.y()).cast<float>());
    points_m.push_back(Eigen::Vector3d(p.x(), p.y(), p.x() + p.y() + 0.9).cast<float>());
  }
  EXPECT_EQ(NumGroups(points_m), 2U);  // 0.9 / sqrt(3) apart
}

TEST(Link, AClumpAmidASphereIsAGroupOfItsOwn) {
  Random random(5);
  const Eigen::Vector3f centre_m(5.0F, 5.0F, 0.0F);
  Points points_m(kMany / 2, centre_m);
  for (std::uint32_t i = 0; i < kMany / 2; ++i) {
    const Eigen::Vector3f direction = random.NormalVector(1.0).normalized().cast<float>();
    points_m.push_back(centre_m + 0.501F * direction);
  }
  EXPECT_EQ(NumGroups(points_m), 2U);
}

TEST(Link, ManyReturnsAlongALineAreOneGroup) {
  for (const double step_m : {1e-5, 0.4, 0.6}) {
    Points points_m;
    for (std::uint32_t i = 0; i < kMany; ++i) {
      points_m.emplace_back(static_cast<float>(step_m * i), 1.0F, 1.0F);
    }
    EXPECT_EQ(NumGroups(points_m), step_m < 0.5 ? 1U : kMany) << step_m;
  }
}

TEST(Link, ManyReturnsOfFlatGroundAreOneGroup) {
  Random random(6);
  Points points_m;
  const double half_m = std::sqrt(kMany / 140.0);  // 35 returns per square metre
  for (std::uint32_t i = 0; i < kMany; ++i) {
    points_m.emplace_back(
        random.InBox({-half_m, -half_m, -2.1}, {half_m, half_m, -1.9}).cast<float>());
  }
  for (const RangeRadius& radius : {PlotConfig().link, RangeRadius{1.5, 0.02}}) {
    EXPECT_EQ(NumGroups(points_m, radius), 1U);
  }
}

TEST(Link, WhatALinkerFoundBeforeChangesNothing) {
  Random random(6);
  Linker linker;
  for (const std::size_t size : {300U, 20U, 0U, 700U, 1U}) {
    Points points_m;
    for (std::size_t i = 0; i < size; ++i) {
      points_m.push_back(random.InBox({-10, -10, -2}, {10, 10, 10}).cast<float>());
    }
    const auto all = AllOf(points_m);
    linker.Link(points_m, all, {1.5, 0.02});
    const Groups expected = Link(points_m, all, {1.5, 0.02});
    ASSERT_EQ(linker.size(), expected.size());
    for (std::size_t g = 0; g < expected.size(); ++g) EXPECT_EQ(MembersOf(linker, g), expected[g]);
  }
}

}  // namespace
}  // namespace unlidar
