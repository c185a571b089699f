#include "live/live_clutter.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "scene/field_of_view.hpp"
#include "scene/ground.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

constexpr double kPeriodS = 0.1;
constexpr int kFrames = 30;
const Eigen::Vector3d kTwig_m(10.0, 4.0, 3.0);
const Eigen::Vector3d kOnce_m(-12.0, 20.0, 9.0);

std::uint32_t BinOf(int i) { return static_cast<std::uint32_t>(i * kPeriodS / kBinS); }

class LiveClutterTest : public ::testing::Test {
 protected:
  LiveClutterTest()
      : ground_(structure_m_),
        support_(structure_m_, ground_, FieldOfView().Edges(), config_.support) {}

  // A twig that is hit now and then, and one thing that was there once, in the first frame.
  static std::vector<LivePlot> PlotsOf(int i) {
    std::vector<LivePlot> plots;
    const auto add = [&](const Eigen::Vector3d& place_m) {
      plots.emplace_back();
      Plot& plot = plots.back().plot;
      plot.position_m = plot.ray_m = place_m;
      plot.variance_m2 = 0.02;
      plot.frame = static_cast<std::uint32_t>(i);
      plot.frame_time_ns = NsOf(i * kPeriodS);
      plots.back().bin = BinOf(i);
    };
    if (i % 6 == 0) add(kTwig_m);
    if (i == 0) add(kOnce_m);
    return plots;
  }

  std::vector<LivePlot> Judge(LiveClutter* clutter, int i) const {
    std::vector<LivePlot> plots = PlotsOf(i);
    clutter->Judge(support_, 0, BinOf(i), &plots);
    return plots;
  }

  RobustConfig config_;
  std::vector<Eigen::Vector3f> structure_m_;
  Ground ground_;
  Support support_;
};

TEST_F(LiveClutterTest, WhatIsForeseenTellsOfTheClutterBeforeIt) {
  LiveClutter clutter(config_, 60.0);
  LiveClutter blind(config_, 60.0);
  for (int i = 0; i < kFrames; ++i) clutter.AddLookahead(0, BinOf(i), PlotsOf(i));
  const std::vector<LivePlot> first = Judge(&clutter, 0);
  EXPECT_GT(first[0].plot.log_clutter, first[1].plot.log_clutter + 3.0);
  const std::vector<LivePlot> unforeseen = Judge(&blind, 0);
  EXPECT_NEAR(unforeseen[0].plot.log_clutter, unforeseen[1].plot.log_clutter, 0.1);
}

TEST_F(LiveClutterTest, WhatABlindedSensorSeesIsNotKnownToFloat) {
  LiveClutter clutter(config_, 60.0);
  for (int i = 0; i < 120; ++i) {
    std::vector<LivePlot> plots(1);
    plots[0].plot.position_m = plots[0].plot.ray_m = kTwig_m;
    plots[0].plot.variance_m2 = 0.02;
    plots[0].plot.frame = static_cast<std::uint32_t>(i);
    clutter.SetBlinded(i >= 90);
    plots[0].plot.frame_time_ns = NsOf(i * kPeriodS);
    clutter.Judge(support_, 0, BinOf(i), &plots);
    if (i > 60) {
      EXPECT_EQ(plots[0].plot.is_floating, i < 90) << i;
    }
  }
}

// Once it lies behind, it counts as what was not foreseen.
TEST_F(LiveClutterTest, WhatWasForeseenCountsOnce) {
  LiveClutter clutter(config_, 60.0);
  LiveClutter blind(config_, 60.0);
  for (int i = 0; i < kFrames; ++i) clutter.AddLookahead(0, BinOf(i), PlotsOf(i));
  for (int i = 0; i < 2 * kFrames; ++i) {
    const std::vector<LivePlot> a = Judge(&clutter, i);
    const std::vector<LivePlot> b = Judge(&blind, i);
    if (i < kFrames + 13) continue;
    for (std::size_t k = 0; k < a.size(); ++k) {
      EXPECT_NEAR(a[k].plot.log_clutter, b[k].plot.log_clutter, 0.05) << i;
    }
  }
}

TEST_F(LiveClutterTest, WhatIsRemovedOrOlderThanTheWindowIsNoClutter) {
  LiveClutter removing(config_, 60.0);
  LiveClutter keeping(config_, 60.0);
  LiveClutter forgetting(config_, 60.0);
  LiveClutter fresh(config_, 60.0);
  for (int i = 0; i < 300; ++i) {
    for (const LivePlot& seen : Judge(&removing, i)) removing.RemoveFromClutter(seen);
    Judge(&keeping, i);
    Judge(&forgetting, i);
  }
  forgetting.Sweep(BinOf(2000));
  // Frames without plots take time as well.
  std::vector<LivePlot> none;
  for (int i = 300; i < 420; ++i) {
    for (LiveClutter* clutter : {&removing, &keeping, &forgetting, &fresh}) {
      clutter->Judge(support_, 0, BinOf(i), &none);
    }
  }
  constexpr int kNext = 420;  // with a plot of the twig
  const double removed = Judge(&removing, kNext)[0].plot.log_clutter;
  const double forgotten = Judge(&forgetting, kNext)[0].plot.log_clutter;
  EXPECT_GT(Judge(&keeping, kNext)[0].plot.log_clutter, removed + 3.0);
  EXPECT_EQ(forgotten, Judge(&fresh, kNext)[0].plot.log_clutter);
  EXPECT_LT(removed, forgotten);  // over more frames
  // Once more: what was forgotten cannot be removed.
  LivePlot old = PlotsOf(0)[0];
  forgetting.RemoveFromClutter(old);
  EXPECT_GT(Judge(&forgetting, kNext + 6)[0].plot.log_clutter, forgotten);
}

// Crowns along a road: each is seen once, but always about as far ahead.
TEST_F(LiveClutterTest, WhatComesByAlongTheWayIsClutterAlsoWhereNothingWasSeenYet) {
  const auto log_clutter = [&](bool travels) {
    LiveClutter clutter(config_, 60.0);
    std::vector<LivePlot> plots;
    for (int i = 0; i < 60; ++i) {
      LivePlot seen;
      Plot& plot = seen.plot;
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
      plot.frame_time_ns = NsOf(i * kPeriodS);
      plots.assign(1, seen);
      clutter.Judge(support_, 0, BinOf(i), &plots);
    }
    return plots.front().plot.log_clutter;
  };
  EXPECT_GT(log_clutter(true), log_clutter(false) + 1.0);
}

}  // namespace
}  // namespace unlidar
