#include "live/live_clutter.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "scene/field_of_view.hpp"
#include "scene/ground.hpp"

namespace unlidar {
namespace {

constexpr double kPeriodS = 0.1;
constexpr int kFrames = 30;
const Eigen::Vector3d kTwig_m(10.0, 4.0, 3.0);
const Eigen::Vector3d kOnce_m(-12.0, 20.0, 9.0);

class LiveClutterTest : public ::testing::Test {
 protected:
  LiveClutterTest()
      : ground_(structure_m_),
        support_(structure_m_, ground_, FieldOfView().Edges(), config_.background.occluder_cell_deg,
                 config_.support) {}

  // A twig that is hit now and then, and one thing that was there once, in the first frame.
  static std::vector<LivePlot> PlotsOf(int i) {
    std::vector<LivePlot> plots;
    const auto add = [&](const Eigen::Vector3d& place_m) {
      plots.emplace_back();
      Plot& plot = plots.back().plot;
      plot.position_m = plot.ray_m = place_m;
      plot.variance_m2 = 0.02;
      plot.frame = static_cast<std::uint32_t>(i);
    };
    if (i % 6 == 0) add(kTwig_m);
    if (i == 0) add(kOnce_m);
    return plots;
  }

  std::vector<LivePlot> Judge(LiveClutter* clutter, int i) const {
    std::vector<LivePlot> plots = PlotsOf(i);
    clutter->AddFrame(0, i * kPeriodS);
    clutter->Judge(support_, i * kPeriodS, &plots);
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
  for (int i = 0; i < kFrames; ++i) clutter.AddLookahead(0, i * kPeriodS, PlotsOf(i));
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
    clutter.AddFrame(0, i * kPeriodS);
    clutter.Judge(support_, i * kPeriodS, &plots);
    if (i > 60) {
      EXPECT_EQ(plots[0].plot.is_floating, i < 90) << i;
    }
  }
}

// Once it lies behind, it counts as what was not foreseen.
TEST_F(LiveClutterTest, WhatWasForeseenCountsOnce) {
  LiveClutter clutter(config_, 60.0);
  LiveClutter blind(config_, 60.0);
  for (int i = 0; i < kFrames; ++i) clutter.AddLookahead(0, i * kPeriodS, PlotsOf(i));
  for (int i = 0; i < 2 * kFrames; ++i) {
    const std::vector<LivePlot> a = Judge(&clutter, i);
    const std::vector<LivePlot> b = Judge(&blind, i);
    if (i < kFrames + 13) continue;
    for (std::size_t k = 0; k < a.size(); ++k) {
      EXPECT_NEAR(a[k].plot.log_clutter, b[k].plot.log_clutter, 0.05) << i;
    }
  }
}

}  // namespace
}  // namespace unlidar
