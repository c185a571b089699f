#include "scene/clutter.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "tests/learned_occupancy.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodS;
using testing::MiddleS;
using testing::RecordingMaker;

constexpr int kDrone = 1;
constexpr int kOther = 2;

// Plots of clutter, `per_frame` in a box of the sky on average, and its recording.
struct Clutter {
  RecordingMaker maker;
  std::vector<Plot> plots;

  explicit Clutter(std::size_t num_sensors = 1) : maker(12, num_sensors) {}

  void AddPlot(const Eigen::Vector3d& position_m, int label = 0) {
    Plot plot;
    plot.frame = static_cast<std::uint32_t>(maker.recording.frames.size() - 1);
    plot.sensor = maker.recording.frames.back().sensor;
    plot.ray_m = plot.position_m = position_m;
    plot.returns = {static_cast<std::uint32_t>(maker.recording.points_m.size())};
    maker.Add(position_m, label);
    plot.time_ns = maker.recording.frames.back().middle_ns();
    const double beam_m = PlotConfig().noise_per_range * position_m.norm();
    plot.variance_m2 = 0.06 * 0.06 + 0.12 * 0.12 + beam_m * beam_m;
    plots.push_back(plot);
  }
};

const Eigen::Vector3d kSkyLow_m(10, -30, 5);
const Eigen::Vector3d kSkyHigh_m(60, 30, 45);

// The plots have one return each.
void Estimate(const std::vector<char>& assigned, Clutter* clutter) {
  const Recording& recording = clutter->maker.recording;
  testing::LearnedOccupancy learned(recording);
  const std::vector<StationModel> station_models(recording.sensors.size(), learned.ModelAt());
  for (Plot& plot : clutter->plots) {
    plot.place_rate =
        static_cast<double>(learned.Judge(recording, plot.returns.front()).place_rate);
  }
  EstimateClutter(station_models, RobustConfig(), assigned, &clutter->plots);
}

Clutter UniformClutter(
    double per_frame, int num_frames,
    const std::function<void(int, Clutter*)>& fill = [](int, Clutter*) {},
    std::size_t num_sensors = 1) {
  Clutter clutter(num_sensors);
  for (int i = 0; i < num_frames; ++i) {
    clutter.maker.BeginFrame(i * kPeriodS);
    const int count = clutter.maker.random.Poisson(per_frame);
    for (int k = 0; k < count; ++k) {
      clutter.AddPlot(clutter.maker.random.InBox(kSkyLow_m, kSkyHigh_m));
    }
    fill(i, &clutter);
  }
  Estimate(std::vector<char>(clutter.plots.size(), 0), &clutter);
  return clutter;
}

// The median over the plots with a label that are well inside the box.
double MedianLogClutter(const Clutter& clutter, int label = 0) {
  std::vector<double> logs;
  for (const Plot& plot : clutter.plots) {
    const Eigen::Array3d p = plot.position_m.array();
    if (clutter.maker.labels[plot.returns.front()] != label) continue;
    if ((p < kSkyLow_m.array() + 5.0).any() || (p > kSkyHigh_m.array() - 5.0).any()) continue;
    logs.push_back(plot.log_clutter);
  }
  std::nth_element(logs.begin(), logs.begin() + static_cast<std::ptrdiff_t>(logs.size() / 2),
                   logs.end());
  return logs[logs.size() / 2];
}

double LogRate(double per_frame) { return std::log(per_frame / (kSkyHigh_m - kSkyLow_m).prod()); }

// Of a thing at (25, 3, 20) m, somewhere within the noise of its plots.
double LogRateOfSpot(double per_frame) {
  return std::log(per_frame / std::pow(2.0 * M_PI * std::exp(1.0) * 0.0236, 1.5));
}

TEST(EstimateClutter, ApproachesTheRateOfUniformClutter) {
  // About 0.3 plots a neighbourhood and frame: over 150 frames it is known to 15 %, and the median
  // of hundreds of neighbourhoods better.
  EXPECT_NEAR(MedianLogClutter(UniformClutter(200.0, 150)), LogRate(200.0), 0.1);
}

TEST(EstimateClutter, GrowsWithTheRate) {
  double before = -std::numeric_limits<double>::infinity();
  for (const double per_frame : {2.0, 10.0, 50.0, 250.0}) {
    const double found = MedianLogClutter(UniformClutter(per_frame, 100));
    EXPECT_GT(found, before + 1.0);
    before = found;
  }
}

TEST(EstimateClutter, ATargetThatPassesDoesNotRaiseItsOwnClutter) {
  const auto pass = [](int i, Clutter* clutter) {
    clutter->AddPlot({20.0, 8.0 * (MiddleS(i) - 10.0), 20.0}, kDrone);
  };
  const Clutter clutter = UniformClutter(20.0, 200, pass);
  EXPECT_NEAR(MedianLogClutter(clutter, kDrone), LogRate(20.0), 0.7);
  // Here its plots are all there are: next to nothing is to be expected.
  EXPECT_LT(MedianLogClutter(UniformClutter(0.0, 200, pass), kDrone), LogRate(0.5));
}

TEST(EstimateClutter, AThingThatIsSeldomHitHasTheRateAtWhichItIsHit) {
  const Eigen::Vector3d thing_m(25.0, 3.0, 20.0);
  const auto hit = [&](int i, Clutter* clutter) {
    if (i % 12 != 0) return;
    clutter->AddPlot(thing_m + clutter->maker.random.NormalVector(0.05), kDrone);
  };
  const Clutter clutter = UniformClutter(5.0, 240, hit);
  // In one frame of twelve a plot, somewhere within its own noise.
  EXPECT_NEAR(MedianLogClutter(clutter, kDrone), LogRateOfSpot(1.0 / 12.0), 0.3);
  EXPECT_GT(MedianLogClutter(clutter, kDrone), MedianLogClutter(clutter) + 5.0);
}

// Of two plots at one place of the sky, so many frames apart, where things that come again to
// their spots are, besides, or none are.
double LogClutterOfPair(int apart, bool among_twigs) {
  constexpr int kFrames = 600;
  const Eigen::Vector3d place_m(25.0, 3.0, 20.0);
  const auto hit = [&](int i, Clutter* clutter) {
    if (i == kFrames / 2 || i == kFrames / 2 + apart) clutter->AddPlot(place_m, kDrone);
    if (!among_twigs || i % 5 != 0) return;
    testing::Random random(static_cast<std::uint32_t>(i / 5 % 20));  // one of twenty
    clutter->AddPlot(place_m + random.InBox({-2, -2, -2}, {2, 2, 2}), kOther);
  };
  return MedianLogClutter(UniformClutter(5.0, kFrames, hit), kDrone);
}

TEST(EstimateClutter, TheFirstPlotOfAVisitIsNotToldByTheNext) {
  const double log_static = LogRateOfSpot(1.0 / 600.0);
  const double log_chain = 0.5 * (log_static + LogRate(5.0));
  ASSERT_LT(log_chain, log_static - 2.5);
  // A static thing that is hit twice in a minute is known by either plot from the other.
  EXPECT_NEAR(LogClutterOfPair(100, false), log_static, 0.3);
  // But what stops there for half a second has come from anywhere,
  EXPECT_NEAR(LogClutterOfPair(5, false), log_chain, 0.5);
  // unless what is seen there does come again, as a rule.
  EXPECT_GT(LogClutterOfPair(5, true), log_static - 0.5);
}

TEST(EstimateClutter, WhatFloatsIsNotTheClutterOfItsSpotAtOtherTimes) {
  // A drone that hovers is the only thing in its corner of the sky.
  const Eigen::Vector3d hover_m(25.0, 3.0, 20.0);
  const auto hit = [&](int i, Clutter* clutter) {
    if (i % 20 == 0) clutter->AddPlot(hover_m + clutter->maker.random.NormalVector(0.03), kDrone);
  };
  Clutter clutter = UniformClutter(0.0, 400, hit);
  for (Plot& plot : clutter.plots) plot.is_floating = true;
  Estimate(std::vector<char>(clutter.plots.size(), 0), &clutter);
  const double others = MedianLogClutter(clutter, kDrone);
  Estimate(std::vector<char>(clutter.plots.size(), 1), &clutter);
  EXPECT_NEAR(others, MedianLogClutter(clutter, kDrone), 0.1);
}

TEST(EstimateClutter, WhatFloatsIsNoStaticThingThatIsSeldomHit) {
  const Eigen::Vector3d hover_m(25.0, 3.0, 20.0);
  const auto hit = [&](int i, Clutter* clutter) {
    if (i % 12 != 0) return;
    clutter->AddPlot(hover_m + clutter->maker.random.NormalVector(0.05), kDrone);
  };
  Clutter clutter = UniformClutter(5.0, 240, hit);
  const double held = MedianLogClutter(clutter, kDrone);
  const double others = MedianLogClutter(clutter);
  for (Plot& plot : clutter.plots) {
    plot.is_floating = clutter.maker.labels[plot.returns.front()] == kDrone;
  }
  Estimate(std::vector<char>(clutter.plots.size(), 0), &clutter);
  // It is left with the rate of its neighbourhood, of which it is the most.
  EXPECT_LT(MedianLogClutter(clutter, kDrone), held - 3.0);
  EXPECT_EQ(MedianLogClutter(clutter), others);
}

TEST(EstimateClutter, WhatIsExplainedIsNoClutter) {
  // A target that circles comes by the same places again and again.
  const auto circle = [](int i, Clutter* clutter) {
    const double angle = 2.0 * M_PI * MiddleS(i) / 5.0;
    clutter->AddPlot({35.0 + 6.0 * std::cos(angle), 6.0 * std::sin(angle), 25.0}, kDrone);
  };
  Clutter clutter = UniformClutter(20.0, 200, circle);
  EXPECT_GT(MedianLogClutter(clutter, kDrone), LogRate(20.0) + 0.7);
  std::vector<char> assigned(clutter.plots.size());
  for (std::size_t i = 0; i < assigned.size(); ++i) {
    assigned[i] = clutter.maker.labels[clutter.plots[i].returns.front()] == kDrone ? 1 : 0;
  }
  Estimate(assigned, &clutter);
  EXPECT_NEAR(MedianLogClutter(clutter, kDrone), LogRate(20.0), 0.5);
}

TEST(EstimateClutter, IsThatOfThePlotsOwnSensorPerFrameOfIt) {
  // The other sensor makes half as many frames and sees a hundredth of the clutter.
  const auto add_other = [](int i, Clutter* clutter) {
    if (i % 2 != 0) return;
    clutter->maker.BeginFrame(i * kPeriodS, 1);
    const int count = clutter->maker.random.Poisson(2.0);
    for (int k = 0; k < count; ++k) {
      clutter->AddPlot(clutter->maker.random.InBox(kSkyLow_m, kSkyHigh_m), kOther);
    }
  };
  const Clutter clutter = UniformClutter(200.0, 150, add_other, 2);
  EXPECT_NEAR(MedianLogClutter(clutter), LogRate(200.0), 0.1);
  EXPECT_NEAR(MedianLogClutter(clutter, kOther), LogRate(2.0), 0.5);
}

TEST(EstimateClutter, ASensorWithoutClutterHasNextToNoneBesideOneWithMuch) {
  const auto pass = [](int i, Clutter* clutter) {
    clutter->maker.BeginFrame(i * kPeriodS, 1);
    clutter->AddPlot({20.0, 8.0 * (MiddleS(i) - 10.0), 20.0}, kDrone);
  };
  const Clutter clutter = UniformClutter(50.0, 200, pass, 2);
  EXPECT_NEAR(MedianLogClutter(clutter), LogRate(50.0), 0.3);
  EXPECT_LT(MedianLogClutter(clutter, kDrone), MedianLogClutter(clutter) - 4.0);
}

TEST(EstimateClutter, IsAtLeastTheRateOfAllReturnsAtThePlaceUnlessThePlotFloats) {
  // The place is hit in a quarter of the time bins by what leaves no plots; of these bins one is
  // that of the target's plot.
  const Eigen::Vector3d place_m(25.0, 3.0, 20.0);
  Clutter clutter;
  for (int i = 0; i < 240; ++i) {
    clutter.maker.BeginFrame(i * kPeriodS);
    if (i / 5 % 8 >= 2 || i % 5 != 2) continue;
    if (i == 122) {
      clutter.AddPlot(place_m, kDrone);
    } else {
      clutter.maker.Add(place_m, kOther);
    }
  }
  Plot& plot = clutter.plots.front();
  Estimate({0}, &clutter);
  ASSERT_GT(plot.place_rate, 0.0);
  EXPECT_NEAR(plot.log_clutter, std::log(plot.place_rate), 1e-9);
  plot.is_floating = true;
  Estimate({0}, &clutter);
  EXPECT_LT(plot.log_clutter, std::log(plot.place_rate) - 3.0);
}

TEST(EstimateClutter, OfNoPlotsIsNothing) {
  std::vector<Plot> plots;
  EstimateClutter({}, RobustConfig(), {}, &plots);
  EXPECT_TRUE(plots.empty());
}

}  // namespace
}  // namespace unlidar
