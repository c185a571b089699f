// What it takes to let paths exchange tails, however many there are.
#include "tracking/path_exchange.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/synthetic_plots.hpp"

namespace unlidar {
namespace {

using testing::AddClutter;
using testing::AddFlight;
using testing::Random;
using testing::SortByTime;
using testing::WatchOver;

constexpr double kRange_m = 600.0;

// Pairs of targets that cross, at one range, each pair farther from the others than a target flies
// in that time, with strays about them.
std::vector<Plot> Crossings(int num_pairs) {
  std::vector<Plot> plots;
  for (int pair = 0; pair < num_pairs; ++pair) {
    const double azimuth = 0.5 * pair;
    const Eigen::Vector3d at_m(kRange_m * std::cos(azimuth), kRange_m * std::sin(azimuth), 10.0);
    Random random(2);
    for (const Eigen::Vector3d& velocity_mps :
         {Eigen::Vector3d(5, 0, 0), Eigen::Vector3d(0, 0, 5)}) {
      AddFlight([&](double t) { return Eigen::Vector3d(at_m + velocity_mps * (t - 3.0)); }, 60, 0.8,
                -9.0, &random, &plots);
    }
    AddClutter(0.5, 60, at_m.array() - 10.0, at_m.array() + 10.0, &random, &plots);
  }
  SortByTime(&plots);
  return plots;
}

TEST(PathExchange, TakesInProportionToTheNumberOfPlaces) {
  const auto effort_for = [](int num_pairs) {
    const std::vector<Plot> plots = Crossings(num_pairs);
    TrackerConfig config;
    config.return_rate_m2_per_s = 10.0 * kRange_m * kRange_m;
    Effort effort;
    EXPECT_EQ(FindPaths(plots, WatchOver(plots), config, &effort).size(),
              2U * static_cast<std::size_t>(num_pairs));
    return effort;
  };
  const Effort one = effort_for(1);
  const Effort many = effort_for(12);
  EXPECT_GT(one.plots_searched_again, 0U);
  EXPECT_EQ(many.pairs_compared, 12 * one.pairs_compared);
  EXPECT_EQ(many.plots_searched_again, 12 * one.plots_searched_again);
}

}  // namespace
}  // namespace unlidar
