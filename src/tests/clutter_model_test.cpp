#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "scene/clutter.hpp"

namespace unlidar {
namespace {

constexpr double kPeriodS = 0.1;
constexpr int kFrames = 30;
const Eigen::Vector3d kTwig_m(10.0, 4.0, 3.0);
const Eigen::Vector3d kOnce_m(-12.0, 20.0, 9.0);

std::uint32_t BinOf(int i) { return static_cast<std::uint32_t>(i * kPeriodS / kBinS); }

// A twig that is hit now and then, and one thing that was there once, in the first frame.
std::vector<Plot> PlotsOf(int i) {
  std::vector<Plot> plots;
  const auto add = [&](const Eigen::Vector3d& place_m) {
    plots.emplace_back();
    plots.back().position_m = plots.back().ray_m = place_m;
    plots.back().variance_m2 = 0.02;
  };
  if (i % 6 == 0) add(kTwig_m);
  if (i == 0) add(kOnce_m);
  return plots;
}

void Add(const std::vector<Plot>& plots, int i, ClutterModel* clutter) {
  clutter->AddFrames(0, BinOf(i));
  for (const Plot& plot : plots) clutter->Add(plot, BinOf(i));
}

// The clutter of plots that were added, as far as it is known.
std::vector<double> Judge(const std::vector<Plot>& plots, int i, const ClutterModel& clutter) {
  const bool is_squall = clutter.IsSquall(0, BinOf(i));
  std::vector<double> logs;
  for (const Plot& plot : plots) {
    logs.push_back(clutter.IntensityOf(plot, BinOf(i), is_squall).log_clutter);
  }
  return logs;
}

std::vector<double> AddAndJudge(const std::vector<Plot>& plots, int i, ClutterModel* clutter) {
  Add(plots, i, clutter);
  return Judge(plots, i, *clutter);
}

std::vector<double> AddAndJudge(int i, ClutterModel* clutter) {
  return AddAndJudge(PlotsOf(i), i, clutter);
}

ClutterModel Foreseen() {
  ClutterModel clutter{RobustConfig()};
  for (int i = 0; i < kFrames; ++i) Add(PlotsOf(i), i, &clutter);
  return clutter;
}

TEST(ClutterModel, WhatIsForeseenTellsOfTheClutterBeforeIt) {
  ClutterModel blind{RobustConfig()};
  const std::vector<double> first = Judge(PlotsOf(0), 0, Foreseen());
  EXPECT_GT(first[0], first[1] + 3.0);
  const std::vector<double> unforeseen = AddAndJudge(0, &blind);
  EXPECT_NEAR(unforeseen[0], unforeseen[1], 0.1);
}

// Once it lies behind, it counts as what was not foreseen.
TEST(ClutterModel, WhatWasForeseenCountsOnce) {
  ClutterModel clutter = Foreseen();
  ClutterModel blind{RobustConfig()};
  for (int i = 0; i < 2 * kFrames; ++i) {
    const std::vector<double> b = AddAndJudge(i, &blind);
    const std::vector<double> a =
        i < kFrames ? Judge(PlotsOf(i), i, clutter) : AddAndJudge(i, &clutter);
    if (i < kFrames + 13) continue;
    for (std::size_t k = 0; k < a.size(); ++k) EXPECT_NEAR(a[k], b[k], 0.05) << i;
  }
}

TEST(ClutterModel, WhatDenseStraysYieldAtASpotIsNoStaticObject) {
  const ClutterModel clutter = Foreseen();
  std::vector<Plot> twig = PlotsOf(6);
  const double of_twig = Judge(twig, 6, clutter)[0];
  twig[0].stray_group_rate = 10.0;
  EXPECT_LT(Judge(twig, 6, clutter)[0], of_twig - 1.0);
}

TEST(ClutterModel, WhatIsRemovedOrForgottenIsNoClutter) {
  const RobustConfig config;
  ClutterModel removing(config);
  ClutterModel keeping(config);
  ClutterModel forgetting(config);
  ClutterModel fresh(config);
  for (int i = 0; i < 300; ++i) {
    Add(PlotsOf(i), i, &removing);
    for (const Plot& plot : PlotsOf(i)) removing.Remove(plot, BinOf(i));
    Add(PlotsOf(i), i, &keeping);
    Add(PlotsOf(i), i, &forgetting);
  }
  forgetting.Forget(BinOf(300));
  // Frames without plots take time as well.
  for (int i = 300; i < 420; ++i) {
    for (ClutterModel* clutter : {&removing, &keeping, &forgetting, &fresh}) Add({}, i, clutter);
  }
  constexpr int kNext = 420;  // with a plot of the twig
  const double removed = AddAndJudge(kNext, &removing)[0];
  const double forgotten = AddAndJudge(kNext, &forgetting)[0];
  EXPECT_GT(AddAndJudge(kNext, &keeping)[0], removed + 3.0);
  EXPECT_EQ(forgotten, AddAndJudge(kNext, &fresh)[0]);
  EXPECT_LT(removed, forgotten);  // over more frames
  // Once more: what was forgotten cannot be removed.
  forgetting.Remove(PlotsOf(0)[0], BinOf(0));
  EXPECT_GT(AddAndJudge(kNext + 6, &forgetting)[0], forgotten);
}

TEST(ClutterModel, OneSensorIsForgottenWithoutTheOthers) {
  ClutterModel both{RobustConfig()};
  for (int i = 0; i < kFrames; ++i) {
    for (std::uint32_t sensor : {0U, 1U}) {
      both.AddFrames(sensor, BinOf(i));
      for (Plot plot : PlotsOf(i)) {
        plot.sensor = sensor;
        both.Add(plot, BinOf(i));
      }
    }
  }
  both.Forget(1, BinOf(kFrames));
  EXPECT_EQ(both.NumFrames(0, {0, BinOf(kFrames)}), static_cast<std::uint32_t>(kFrames));
  EXPECT_EQ(both.NumFrames(1, {0, BinOf(kFrames)}), 0U);
  EXPECT_EQ(Judge(PlotsOf(6), 6, both), Judge(PlotsOf(6), 6, Foreseen()));
}

// Drops that come all at once are clutter as they come, unless a swarm may explain them, and only
// about where they are.
TEST(ClutterModel, InASquallClutterIsThatOfThePresent) {
  const Eigen::Vector3d kAir_m(-30.0, 0.0, 5.0);
  const auto log_clutter_of_air = [&](const Eigen::Vector3d& drops_m, int num_drops) {
    ClutterModel clutter{RobustConfig()};
    for (int i = 0; i < 99; ++i) Add(PlotsOf(6), i, &clutter);
    std::vector<Plot> plots(static_cast<std::size_t>(num_drops) + 1, PlotsOf(6)[0]);
    for (std::size_t k = 0; k < plots.size(); ++k) {
      const double along_m = 5.0 * static_cast<double>(k) / num_drops;
      plots[k].ray_m = (k == 0 ? kAir_m : drops_m) + along_m * Eigen::Vector3d::UnitZ();
      plots[k].position_m = plots[k].ray_m;
    }
    Add(plots, 100, &clutter);
    const std::uint32_t bin = BinOf(100);
    return clutter.IntensityOf(plots[0], bin, clutter.IsSquall(0, bin)).log_surrounding;
  };
  const double open = log_clutter_of_air(kAir_m, 1);
  EXPECT_LT(open, -10.0);
  EXPECT_EQ(log_clutter_of_air(kAir_m, 20), open);
  EXPECT_GT(log_clutter_of_air(kAir_m, 400), -6.0);
  EXPECT_NEAR(log_clutter_of_air(kAir_m, 800), log_clutter_of_air(kAir_m, 400) + std::log(2.0),
              0.01);
  EXPECT_EQ(log_clutter_of_air(-kAir_m, 400), open);
}

// Crowns along a road: each is seen once, but always about as far ahead.
TEST(ClutterModel, WhatComesByAlongTheWayIsClutterAlsoWhereNothingWasSeenYet) {
  const auto log_clutter = [&](bool travels) {
    ClutterModel clutter{RobustConfig()};
    double last = 0.0;
    for (int i = 0; i < 60; ++i) {
      Plot plot;
      plot.carrier_ray_m = {40.0F, i % 2 == 0 ? 8.0F : -8.0F, 5.0F};
      plot.ray_m = plot.carrier_ray_m.cast<double>();
      const Eigen::Vector3f way_m(static_cast<float>(5 * i), 0.0F, 0.0F);
      if (travels) {
        plot.shift_m = way_m;
      } else {
        plot.ray_m += way_m.cast<double>();
      }
      plot.position_m = plot.PlaceM();
      plot.variance_m2 = 0.02;
      last = AddAndJudge({plot}, i, &clutter)[0];
    }
    return last;
  };
  EXPECT_GT(log_clutter(true), log_clutter(false) + 1.0);
}

}  // namespace
}  // namespace unlidar
