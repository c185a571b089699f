#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "scene/clutter.hpp"
#include "tracking/flight.hpp"

namespace unlidar {
namespace {

constexpr double kPeriodS = 0.1;
constexpr double kDurationS = 60.0;
const Eigen::Vector3d kPlaceM(12.0, 3.0, 4.0);

Plot PlotAt(double time_s, const Eigen::Vector3d& position_m, double log_clutter) {
  Plot plot;
  plot.time_ns = plot.frame_time_ns = NsOf(time_s);
  plot.position_m = plot.ray_m = position_m;
  plot.variance_m2 = 0.003;
  plot.log_clutter = log_clutter;
  return plot;
}

std::uint32_t NumFramesAbout(const Plot& /*plot*/) {
  return static_cast<std::uint32_t>(2.0 * kCrowdingReachS / kPeriodS);
}

// Ten plots at a place from 30 s on, among others at these times and offsets from it.
class Scene {
 public:
  explicit Scene(double log_clutter) : log_clutter_(log_clutter) {}

  void AddOther(double time_s, const Eigen::Vector3d& offset_m = Eigen::Vector3d::Zero()) {
    plots_.push_back(PlotAt(time_s, kPlaceM + offset_m, log_clutter_));
  }

  double Penalty(bool are_targets = false, bool is_floating = false) const {
    std::vector<Plot> plots = plots_;
    for (int k = 0; k < 10; ++k) {
      plots.push_back(PlotAt(30.0 + k * kPeriodS, kPlaceM, log_clutter_));
      plots.back().is_floating = is_floating;
      plots.back().num_returns = kOwn;
    }
    std::stable_sort(plots.begin(), plots.end(), [](const Plot& a, const Plot& b) {
      return a.frame_time_ns < b.frame_time_ns;
    });
    std::vector<std::uint32_t> path;
    std::vector<char> are_free;
    for (std::uint32_t k = 0; k < plots.size(); ++k) {
      const bool is_own = plots[k].num_returns == kOwn;
      if (is_own) path.push_back(k);
      are_free.push_back(is_own || !are_targets ? 1 : 0);
    }
    return CrowdingPenalty(path, plots, are_free, NumFramesAbout);
  }

 private:
  static constexpr std::uint32_t kOwn = 7;

  double log_clutter_;
  std::vector<Plot> plots_;
};

// Log-rate of `count` plots at a spot in a minute.
double LogRateAtSpot(double count) {
  return std::log(count * kPeriodS / kDurationS / PlotVolumeM3(PlotAt(0.0, kPlaceM, 0.0)));
}

TEST(Crowding, IsNoneWhereNothingElseIs) {
  Scene scene(-12.0);
  EXPECT_EQ(scene.Penalty(), 0.0);
  scene.AddOther(30.5, {5.0, 0.0, 0.0});
  scene.AddOther(50.0, {0.5, 0.0, 0.0});  // beside the spot, at another time
  EXPECT_EQ(scene.Penalty(), 0.0);
}

TEST(Crowding, OthersAtTheSameTimeCountUnlessTheyAreOfTargets) {
  Scene scene(-12.0);
  for (int k = 0; k < 5; ++k) scene.AddOther(30.0 + k * kPeriodS, {0.8, 0.0, 0.0});
  EXPECT_GT(scene.Penalty(), 10.0);
  EXPECT_EQ(scene.Penalty(true), 0.0);
}

// The clutter intensity holds for plots that come at any time.
TEST(Crowding, PlotsOfOtherTimesThatComeAsAPoissonProcessAreNone) {
  constexpr int kCount = 60;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> time_s(0.0, kDurationS);
  double sum = 0.0;
  for (int draw = 0; draw < 50; ++draw) {
    Scene scene(LogRateAtSpot(kCount));
    for (int k = 0; k < kCount; ++k) {
      const double at_s = time_s(random);
      if (std::abs(at_s - 30.5) > 5.0) scene.AddOther(at_s);
    }
    sum += scene.Penalty() / 10.0 / 50.0;  // a plot
  }
  EXPECT_LT(sum, 0.15);
}

TEST(Crowding, BurstsAtTheSameSpotCountAsTheyComeNotAsTheirMean) {
  Scene bursts(LogRateAtSpot(30));
  for (const double begin_s : {10.0, 45.0, 52.0}) {
    for (int k = 0; k < 10; ++k) bursts.AddOther(begin_s + k * kPeriodS);
  }
  // Given one, nine are expected in the frames about it, seven times as many as on average.
  const double per_frame = 9.0 / NumFramesAbout({});
  EXPECT_NEAR(bursts.Penalty(), 10.0 * std::log(per_frame / (30.0 * kPeriodS / kDurationS)), 0.6);
  EXPECT_EQ(bursts.Penalty(true), 0.0);
  EXPECT_EQ(bursts.Penalty(false, true), 0.0) << "what floats was there before, too";
}

}  // namespace
}  // namespace unlidar
