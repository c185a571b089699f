#include "live/live_search.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <set>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodNs;
using testing::Random;

constexpr double kRangeM = 57.0;

LivePlot PlotIn(const SceneFrame& frame, int i, const Eigen::Vector3d& position_m) {
  LivePlot seen;
  seen.time_s = frame.time_s;
  seen.stamp_ns = frame.info.stamp_ns;
  Plot& plot = seen.plot;
  plot.frame = static_cast<std::uint32_t>(i);
  plot.time_ns = plot.frame_time_ns = frame.info.middle_ns();
  plot.position_m = plot.ray_m = position_m;
  plot.num_returns = 2;
  return seen;
}

// Plots, one a frame by default, of which none floats.
class Plots {
 public:
  explicit Plots(const Config& config = Config()) : config_(config), search_(config_) {
    SensorInfo info;
    info.frame_period_ns = kPeriodNs;
    search_.SetSensor(0, info);
  }

  // Adds a frame with plots at about a place, or so far apart. Returns the paths that reach the
  // threshold.
  const Queue<Path>& Add(int i, const Eigen::Vector3d& place_m, double height_m = 50.0,
                         std::size_t num_plots = 1,
                         const Eigen::Vector3d& apart_m = Eigen::Vector3d::Zero()) {
    SceneFrame frame;
    frame.info = testing::FrameAt(i);
    frame.time_s = testing::MiddleS(i);
    frame.observed_s = 60.0;
    for (std::size_t k = 0; k < num_plots; ++k) {
      const Eigen::Vector3d at_m = place_m + static_cast<double>(k) * apart_m;
      frame.plots.push_back(PlotIn(frame, i, at_m + random_.NormalVector(0.15)));
      Plot& plot = frame.plots.back().plot;
      plot.variance_m2 = 0.03;
      plot.lowest_m = height_m;
      plot.log_clutter = -3.0;
    }
    search_.Begin(frame);
    return search_.Extend(frame, std::vector<char>(num_plots, 1));
  }

  LiveSearch& search() { return search_; }

 private:
  const Config config_;  // the search keeps a reference to it
  LiveSearch search_;
  Random random_{5};
};

template <class PlaceAt>
bool HasFlight(int num_frames, const PlaceAt& place_at) {
  const Config config;
  Plots plots(config);
  for (int i = 0; i < num_frames; ++i) {
    for (const Path& path : plots.Add(i, place_at(testing::MiddleS(i)))) {
      if (plots.search().Judge(path) == Rejection::kNone) return true;
    }
  }
  return false;
}

// What the first flight of 3 m/s must reach that is found so long after the start, by default while
// clutter is hardly known, beside three plots a frame that lie about a place which moves along at
// this distance. `shift_m`: of the sensor.
double LeastScoreBeside(double distance_m, const Config& config = Config(), double observed_s = 3.0,
                        float shift_m = 0.0F) {
  LiveSearch search(config);
  SensorInfo info;
  info.frame_period_ns = kPeriodNs;
  search.SetSensor(0, info);
  Random random(6);
  constexpr int kNumOthers = 3;
  for (int i = 0; i < 30; ++i) {
    SceneFrame frame;
    frame.info = testing::FrameAt(i);
    frame.time_s = testing::MiddleS(i);
    frame.observed_s = observed_s;
    const Eigen::Vector3d at_m(3.0 * frame.time_s, 0.0, 20.0);
    for (int k = 0; k <= kNumOthers; ++k) {
      const Eigen::Vector3d apart_m(0.0, distance_m, 0.0);
      frame.plots.push_back(
          PlotIn(frame, i, k == 0 ? at_m : at_m + (apart_m + random.NormalVector(0.8))));
      Plot& plot = frame.plots.back().plot;
      plot.shift_m.x() = shift_m;
      plot.variance_m2 = 0.002;
      plot.lowest_m = 20.0;
      plot.log_clutter = k == 0 ? -6.0 : 0.0;
    }
    search.Begin(frame);
    for (const Path& path : search.Extend(frame, {1, 1, 1, 1})) {
      if (search.Judge(path) == Rejection::kNone) return search.ScoreThresholdOfFlight();
    }
  }
  ADD_FAILURE() << "no flight";
  return 0.0;
}

TEST(LiveSearch, WhatHasOthersAboutItMustBeSurerAtFirst) {
  EXPECT_GT(LeastScoreBeside(0.0), LeastScoreBeside(30.0) + 2.0);
  for (const Rule rule : {Rule::kCrowded, Rule::kClutterLearning}) {
    Config config;
    config.robust.disabled_rules = {rule};
    EXPECT_NEAR(LeastScoreBeside(0.0, config), LeastScoreBeside(30.0, config), 1.0);
    EXPECT_EQ(LeastScoreBeside(30.0, config) < LeastScoreBeside(30.0) - 2.0,
              rule == Rule::kClutterLearning);
  }
}

TEST(LiveSearch, FromTravelWhatHasOthersAboutItMustBeSurerForever) {
  const Config config;
  constexpr double kLongS = 3600.0;
  constexpr float kAwayM = 100.0F;
  EXPECT_NEAR(LeastScoreBeside(0.0, config, kLongS), LeastScoreBeside(30.0, config, kLongS), 1.0);
  EXPECT_GT(LeastScoreBeside(0.0, config, kLongS, kAwayM),
            LeastScoreBeside(30.0, config, kLongS, kAwayM) + 2.0);
  Config without;
  without.robust.disabled_rules = {Rule::kCrowded};
  EXPECT_NEAR(LeastScoreBeside(0.0, without, kLongS, kAwayM),
              LeastScoreBeside(30.0, without, kLongS, kAwayM), 1.0);
}

// Rejections of the paths of a target of 3 m/s above the threshold, after so many frames.
std::set<Rejection> RejectionsOf(const Config& config, double height_m = 50.0,
                                 double speed_mps = 3.0) {
  Plots plots(config);
  std::set<Rejection> rejections;
  constexpr int kFrames = 60;
  for (int i = 0; i < kFrames; ++i) {
    const Eigen::Vector3d place_m(speed_mps * testing::MiddleS(i) - 10.0, 0.0, kRangeM);
    for (const Path& path : plots.Add(i, place_m, height_m)) {
      if (i + 1 == kFrames) rejections.insert(plots.search().Judge(path));
    }
  }
  return rejections;
}

Config Without(Rule rule) {
  Config config;
  config.robust.disabled_rules = {rule};
  return config;
}

TEST(LiveSearch, EachGateIsReachedAndNamed) {
  using Names = std::set<Rejection>;
  const Config config;
  EXPECT_EQ(RejectionsOf(config), Names{Rejection::kNone});
  Config few = config;
  few.robust.min_plots = 1000;
  EXPECT_EQ(RejectionsOf(few), Names{Rejection::kTooFewDetections});
  EXPECT_EQ(RejectionsOf(config, 0.5), Names{Rejection::kNearGround});
  Config strong = config;
  strong.robust.min_cross_section_m2 = 1e6;
  EXPECT_EQ(RejectionsOf(strong), Names{Rejection::kWeakReturn});
  EXPECT_EQ(RejectionsOf(config, 50.0, 0.0), Names{Rejection::kStationary});
  EXPECT_EQ(RejectionsOf(Without(Rule::kStationary), 50.0, 0.0), Names{Rejection::kNone});
}

constexpr double kFlyingM = 50.0;
constexpr double kWalkingM = 0.6;

// Numbers of plots cut off a path of two parts: `num_before` plots at a height above the ground,
// and a flight that goes on `aside_m` from their way after a pause.
std::vector<std::size_t> CutsOf(int num_before, double pause_s, double aside_m,
                                const Config& config = Config(), double height_m = kFlyingM) {
  Plots plots(config);
  Path path;
  const int pause = static_cast<int>(pause_s / testing::kPeriodS);
  for (int i = 0; i < num_before + pause + 20; ++i) {
    if (i >= num_before && i < num_before + pause) continue;
    plots.Add(i, {3.0 * testing::MiddleS(i) - 10.0, i < num_before ? 0.0 : aside_m, kRangeM},
              i < num_before ? height_m : kFlyingM);
    path.plots.push_back(static_cast<std::uint32_t>(path.plots.size()));
  }
  EXPECT_EQ(plots.search().Judge(path), Rejection::kNone);
  std::vector<std::size_t> cuts;
  for (const PathCut& cut : plots.search().cuts()) {
    EXPECT_EQ(cut.rule, Rejection::kPause);
    cuts.push_back(cut.num_plots);
  }
  return cuts;
}

// What precedes a long pause is the target's where one target is likelier than two, or than one and
// strays.
TEST(LiveSearch, BeforeALongPauseAFlightKeepsWhatOneTargetExplains) {
  using Cuts = std::vector<std::size_t>;
  for (const std::size_t num_before : {5U, 20U}) {
    const auto count = static_cast<int>(num_before);
    for (const double pause_s : {3.5, 6.0}) {
      EXPECT_EQ(CutsOf(count, pause_s, 0.0), Cuts{}) << num_before << " " << pause_s;
      EXPECT_EQ(CutsOf(count, pause_s, 60.0), Cuts{num_before}) << num_before << " " << pause_s;
    }
    EXPECT_EQ(CutsOf(count, 2.0, 60.0), Cuts{}) << num_before;
    EXPECT_EQ(CutsOf(count, 6.0, 60.0, Without(Rule::kPause)), Cuts{}) << num_before;
  }
}

// What walks or drives before a pause is not the drone that is seen behind it, where one target is
// less likely than two. Of a few plots nobody knows.
TEST(LiveSearch, BeforeAPauseAFlightLosesWhatIsNoDrone) {
  using Cuts = std::vector<std::size_t>;
  const auto cuts_of = [](int num_before, double pause_s, double aside_m, double height_m) {
    return CutsOf(num_before, pause_s, aside_m, Config(), height_m);
  };
  EXPECT_EQ(cuts_of(20, 2.0, 60.0, kWalkingM), Cuts{20});
  EXPECT_EQ(cuts_of(20, 2.0, 60.0, kFlyingM), Cuts{});
  EXPECT_EQ(cuts_of(20, 2.0, 0.0, kWalkingM), Cuts{});
  EXPECT_EQ(cuts_of(20, 0.8, 60.0, kWalkingM), Cuts{});
  EXPECT_EQ(cuts_of(4, 2.0, 60.0, kWalkingM), Cuts{});
}

// The rule that refuses a path of `num_low` plots on the ground and `num_high` above it.
Rejection RejectionOfTakeOff(int num_low, int num_high) {
  Plots plots;
  Path path;
  for (int i = 0; i < num_low + num_high; ++i) {
    plots.Add(i, {3.0 * testing::MiddleS(i) - 10.0, 0.0, kRangeM}, i < num_low ? 0.6 : 4.0);
    path.plots.push_back(static_cast<std::uint32_t>(i));
  }
  return plots.search().Judge(path);
}

TEST(LiveSearch, ADroneThatTakesOffIsJudgedByWhatIsHigh) {
  EXPECT_EQ(RejectionOfTakeOff(30, 26), Rejection::kNone);
  EXPECT_EQ(RejectionOfTakeOff(90, 26), Rejection::kNone);  // whatever its share
  EXPECT_EQ(RejectionOfTakeOff(30, 4), Rejection::kNearGround);
}

// A path that came across a pause from strays, though the target was seen before them.
TEST(LiveSearch, AFlightIsFollowedBackTheLikelierWay) {
  const auto place_at = [](int i) {
    return Eigen::Vector3d(3.0 * testing::MiddleS(i) - 10.0, 0.0, kRangeM);
  };
  constexpr int kNumBefore = 20;
  constexpr int kNumAfter = 12;
  for (const double aside_m : {0.0, 12.0}) {
    Plots plots;
    Path path;
    for (int i = 0; i < kNumBefore; ++i) plots.Add(i, place_at(i));
    for (int i = kNumBefore; i < kNumBefore + 3; ++i) {
      plots.Add(i, place_at(i) + Eigen::Vector3d(0.0, aside_m, 0.0));
      path.plots.push_back(static_cast<std::uint32_t>(i));
    }
    for (int k = 0; k < kNumAfter; ++k) {
      const int i = kNumBefore + k + static_cast<int>(4.0 / testing::kPeriodS);
      plots.Add(i, place_at(i));
      path.plots.push_back(static_cast<std::uint32_t>(kNumBefore + 3 + k));
    }
    EXPECT_EQ(plots.search().Judge(path), Rejection::kNone);
    const Flight whole = plots.search().WithHistory();
    EXPECT_EQ(whole.plots.size(),
              static_cast<std::size_t>(kNumBefore + kNumAfter) + (aside_m == 0.0 ? 3U : 0U));
    EXPECT_EQ(whole.plots.front().plot.frame, 0U);
  }
}

TEST(LiveSearch, APathIsPrunedOfPlotsThatLowerItsScore) {
  const Config config;
  Plots plots(config);
  const auto place_at = [](int i) {
    return Eigen::Vector3d(3.0 * testing::MiddleS(i) - 10.0, 0.0, kRangeM);
  };
  Path whole;
  plots.Add(0, place_at(0) + Eigen::Vector3d(25.0, 0.0, 0.0));  // no flight leads from here
  whole.plots.push_back(0);
  for (int i = 20; i < 60; ++i) {
    plots.Add(i, place_at(i));
    whole.plots.push_back(static_cast<std::uint32_t>(whole.plots.size()));
  }
  Path flight = whole;
  flight.plots.erase(flight.plots.begin());
  EXPECT_EQ(plots.search().Pruned(whole).plots, flight.plots);
  EXPECT_EQ(plots.search().Pruned(flight).plots, flight.plots);
  // A path to the present frame ends there, whatever its last plot does to the score.
  plots.Add(80, place_at(80) + Eigen::Vector3d(0.0, 25.0, 0.0));
  flight.plots.push_back(static_cast<std::uint32_t>(whole.plots.size()));
  whole.plots.push_back(flight.plots.back());
  EXPECT_EQ(plots.search().Pruned(whole).plots, flight.plots);
}

TEST(LiveSearch, AVerdictStandsUntilAPathHasGrownByATenthOrByAPath) {
  const Config config;
  Plots plots(config);
  const auto most = static_cast<std::size_t>(config.robust.min_plots);
  std::size_t left = 0;  // plots for which the last verdict stands
  std::size_t num_judged = 0;
  for (int i = 0; i < 120; ++i) {
    // The first plots of a path are forgotten, the verdict on it is not.
    if (i == 90) {
      EXPECT_EQ(plots.search().Forget(testing::FrameAt(40).begin_ns), 40U);
    }
    const Queue<Path>& paths = plots.Add(i, {3.0 * testing::MiddleS(i) - 10.0, 0.0, kRangeM}, 0.6);
    if (paths.empty()) continue;
    const Path& path = paths.front();
    const Rejection standing = plots.search().StandingRejection(path);
    ASSERT_EQ(standing, left > 0 ? Rejection::kNearGround : Rejection::kNone) << i;
    if (left > 0) {
      --left;
      continue;
    }
    plots.search().LetStand(Rejection::kNearGround, path);
    left = std::min(path.plots.size() / 10, most);
    ++num_judged;
  }
  EXPECT_GT(num_judged, 20U);
}

TEST(LiveSearch, PlotsOfAPathThatIsRefusedAsNearTheGroundAreThoseOfAGroundTarget) {
  const auto gain_of = [](double height_m, const Config& config, bool is_refused) {
    Plots plots(config);
    const auto place_m = [](int i) {
      return Eigen::Vector3d(1.5 * testing::MiddleS(i) - 10.0, 0.0, kRangeM);
    };
    for (int i = 0; i < 40; ++i) {
      for (const Path& path : plots.Add(i, place_m(i), 0.6)) {
        if (!is_refused) continue;
        EXPECT_EQ(plots.search().Judge(path), Rejection::kNearGround);
      }
    }
    SceneFrame frame;
    frame.info = testing::FrameAt(40);
    frame.time_s = testing::MiddleS(40);
    frame.plots.push_back(PlotIn(frame, 40, place_m(40)));
    frame.plots[0].plot.variance_m2 = 0.03;
    frame.plots[0].plot.lowest_m = height_m;
    frame.plots[0].plot.log_clutter = -3.0;
    plots.search().Begin(frame);
    std::vector<double> gains;
    plots.search().GetGroundGains(frame, &gains);
    return gains.empty() ? -1.0 : gains[0];
  };
  EXPECT_GT(gain_of(0.6, Config(), true), 3.0);
  EXPECT_EQ(gain_of(0.6, Config(), false), 0.0);
  EXPECT_EQ(gain_of(6.0, Config(), true), 0.0);
  Config config;
  config.robust.disabled_rules = {Rule::kGroundClaim};
  EXPECT_EQ(gain_of(0.6, config, true), -1.0);
}

TEST(LiveSearch, ThatAPathHasTooFewDetectionsStandsForNoneThatItGets) {
  for (const Rejection rejection : {Rejection::kTooFewDetections, Rejection::kWeakReturn}) {
    Plots plots;
    Rejection standing = Rejection::kNone;
    for (int i = 0; i < 60; ++i) {
      const Queue<Path>& paths = plots.Add(i, {3.0 * testing::MiddleS(i), 0.0, kRangeM});
      if (i == 58) plots.search().LetStand(rejection, paths.front());
      if (i == 59) standing = plots.search().StandingRejection(paths.front());
    }
    const bool stands = rejection != Rejection::kTooFewDetections;
    EXPECT_EQ(standing, stands ? rejection : Rejection::kNone);
  }
}

TEST(LiveSearch, APathWithAPlotOfATrackIsRefusedForThat) {
  const Config config;
  Plots plots(config);
  for (int i = 0; i < 60; ++i) {
    for (const Path& path : plots.Add(i, {3.0 * testing::MiddleS(i), 0.0, kRangeM})) {
      if (plots.search().Judge(path) != Rejection::kNone) continue;
      plots.search().Take(path);
      EXPECT_EQ(plots.search().Judge(path), Rejection::kSharesReturns);
      return;
    }
  }
  ADD_FAILURE() << "no flight";
}

// A thing at rest, and in the last frames a stray 60 m beside it, by which the mean of its last
// third moves by 3 m. It is no flight where the thing was judged before, or its verdict stands.
TEST(LiveSearch, MostPlotsOfALikelierPathThatIsRefusedAreNoFlight) {
  constexpr int kFrames = 60;
  const Eigen::Vector3d place_m(0.0, 0.0, kRangeM);
  const Eigen::Vector3d to_stray_m(60.0, 0.0, 0.0);
  Plots plots;
  LiveSearch& search = plots.search();
  Path at_rest;
  const auto add_stray = [&](int i) {
    plots.Add(i, place_m, 50.0, 2, to_stray_m);
    Path astray = at_rest;
    const auto number = static_cast<std::uint32_t>(search.seen().size() - 2);
    at_rest.plots.push_back(number);
    astray.plots.push_back(number + 1);
    return astray;
  };
  for (int i = 0; i < kFrames; ++i) {
    plots.Add(i, place_m);
    at_rest.plots.push_back(static_cast<std::uint32_t>(i));
  }
  const Path astray = add_stray(kFrames);
  EXPECT_EQ(search.Judge(astray), Rejection::kNone);
  EXPECT_EQ(search.Judge(at_rest), Rejection::kStationary);
  search.LetStand(Rejection::kStationary, at_rest);
  EXPECT_EQ(search.Judge(astray), Rejection::kStationary);
  const Path next = add_stray(kFrames + 1);
  EXPECT_EQ(search.Judge(next), Rejection::kNone);
  EXPECT_EQ(search.StandingRejection(at_rest), Rejection::kStationary);
  EXPECT_EQ(search.Judge(next), Rejection::kStationary);
  search.LetStand(Rejection::kStationary, next);
  Path further = next;
  further.plots.push_back(at_rest.plots.back());
  EXPECT_EQ(search.StandingRejection(further), Rejection::kNone);
}

TEST(LiveSearch, TheRefusalOfALikelierPathCanBeSwitchedOff) {
  Config config;
  config.robust.disabled_rules = {Rule::kLikelierRefusal};
  Plots plots(config);
  LiveSearch& search = plots.search();
  const Eigen::Vector3d place_m(0.0, 0.0, kRangeM);
  Path at_rest;
  for (std::uint32_t i = 0; i < 60; ++i) {
    plots.Add(static_cast<int>(i), place_m);
    at_rest.plots.push_back(i);
  }
  Path astray = at_rest;
  plots.Add(60, place_m, 50.0, 2, {60.0, 0.0, 0.0});
  at_rest.plots.push_back(60);
  astray.plots.push_back(61);
  EXPECT_EQ(search.Judge(at_rest), Rejection::kStationary);
  EXPECT_EQ(search.Judge(astray), Rejection::kNone);
}

// Every path that reaches the threshold is the best one to a plot.
TEST(LiveSearch, ScoresOfPlotsAreThoseOfTheBestPaths) {
  const Config config;
  Plots plots(config);
  bool reached = false;
  for (int i = 0; i < 60; ++i) {
    const Queue<Path>& paths = plots.Add(i, {3.0 * testing::MiddleS(i), 0.0, kRangeM});
    std::vector<double> scores;
    plots.search().GetScores(&scores);
    ASSERT_EQ(scores.size(), 1U);
    const double threshold = plots.search().score_threshold();
    EXPECT_EQ(paths.empty(), scores[0] < threshold);
    if (i < kMinPathPlots - 1) {
      EXPECT_EQ(scores[0], 0.0);
    }
    if (paths.empty()) continue;
    EXPECT_EQ(scores[0], paths.front().score);
    reached = true;
  }
  EXPECT_TRUE(reached);
}

TEST(LiveSearch, ItsMemoryIsBoundedHoweverManyPlotsComeAndAFlightIsFoundThen) {
  constexpr std::size_t kMost = 240'000;
  const auto place_at = [](int i) {
    return Eigen::Vector3d(3.0 * testing::MiddleS(i), 0.0, kRangeM);
  };
  Plots plots;
  LiveSearch& search = plots.search();
  for (int i = 0; i < 10; ++i) plots.Add(i, place_at(i));
  EXPECT_FALSE(search.IsFull());
  EXPECT_EQ(search.Forget(testing::FrameAt(2).begin_ns), 2U);
  plots.Add(10, {0.0, 500.0, kRangeM}, 50.0, kMost);  // strays beyond the reach of any flight
  EXPECT_TRUE(search.IsFull());
  EXPECT_EQ(search.Forget(0), kMost / 4 + 8);
  EXPECT_FALSE(search.IsFull());
  EXPECT_EQ(search.seen().size(), 3 * kMost / 4);
  EXPECT_EQ(search.Forget(testing::FrameAt(11).begin_ns), 3 * kMost / 4);
  bool is_found = false;
  for (int i = 11; i < 60 && !is_found; ++i) {
    for (const Path& path : plots.Add(i, place_at(i))) {
      is_found = is_found || search.Judge(path) == Rejection::kNone;
    }
  }
  EXPECT_TRUE(is_found);
}

TEST(LiveSearch, WhatStandsAndDoesNotFloatIsNoFlight) {
  EXPECT_FALSE(HasFlight(300, [](double) { return Eigen::Vector3d(0.0, 0.0, kRangeM); }));
}

}  // namespace
}  // namespace unlidar
