#include "tracking/tracker.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "base/algorithms.hpp"
#include "tests/draws.hpp"
#include "tests/several_threads.hpp"
#include "tests/synthetic_plots.hpp"
#include "tests/tracker_oracle.hpp"

namespace unlidar {
namespace {

using testing::AddClutter;
using testing::AddFlight;
using testing::Flight;
using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::kScoreTolerance;
using testing::MakePlot;
using testing::MixSensors;
using testing::PlainScore;
using testing::Random;
using testing::SortByTime;
using testing::WatchOver;

// The best of all sequences that a search may find, with one plot a time at most.
Path BestByEnumeration(const std::vector<Plot>& plots, const TrackerConfig& config,
                       int num_sensors) {
  Path best;
  for (std::uint32_t subset = 1; subset < (1U << plots.size()); ++subset) {
    std::vector<std::uint32_t> members;
    bool is_path = true;
    for (std::uint32_t i = 0; i < plots.size(); ++i) {
      if ((subset >> i & 1U) == 0) continue;
      is_path = is_path && (members.empty() || plots[members.back()].time_ns < plots[i].time_ns);
      members.push_back(i);
    }
    if (!is_path || static_cast<int>(members.size()) < kMinPathPlots) continue;
    const double score = PlainScore(plots, members, config, num_sensors, true);
    if (score > best.score) best = {members, score};
  }
  return best;
}

// Up to ten plots: a few of a target that flies about, the others of clutter near it, some in one
// frame, some with a pause between them.
std::vector<Plot> TinyProblem(Random* random) {
  const double log_clutter = random->Uniform(-9.0, -3.0);
  const Eigen::Vector3d start_m = random->InBox({-5, 5, 5}, {5, 15, 15});
  const Eigen::Vector3d velocity_mps = random->NormalVector(4.0);
  const Eigen::Vector3d acceleration_mps2 = random->NormalVector(2.0);
  const TimeNs pause_ns = 20 * static_cast<TimeNs>(random->Index(2)) * kPeriodNs;
  std::vector<Plot> plots;
  const std::uint32_t count = 6 + random->Index(5);
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto frame = static_cast<TimeNs>(random->Index(12));
    const TimeNs time_ns = frame * kPeriodNs + (frame < 6 ? 0 : pause_ns);
    const double time_s = static_cast<double>(time_ns) * kSecondsPerNs;
    Eigen::Vector3d position_m =
        start_m + velocity_mps * time_s + 0.5 * acceleration_mps2 * time_s * time_s;
    position_m += random->NormalVector(i % 3 == 2 ? 1.0 : 0.15);
    plots.push_back(MakePlot(kBeginNs + time_ns, position_m,
                             log_clutter + random->Uniform(-1.0, 1.0), 1 + random->Index(4)));
  }
  SortByTime(&plots);
  return plots;
}

// The best path that the search finds, before any exchange.
Path BestOf(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
            const TrackerConfig& config) {
  const std::vector<double> log_births = LogBirths(plots, scan_schedule, config);
  const std::vector<Scan> scans = ScansOf(plots, log_births, scan_schedule);
  const std::vector<char> free(plots.size(), 1);
  Path best;
  for (const double sigma_a_mps2 : config.sigma_a_mps2) {
    const TrackModel model(sigma_a_mps2, scan_schedule, config);
    Path path = TrackSearch(log_births, scans, free, 0.0, model, config).Best();
    if (path.score > best.score) best = std::move(path);
  }
  return best;
}

TrackerConfig WithAllWays(TrackerConfig config) {
  config.hypotheses_per_plot = 1'000'000;
  config.max_hypotheses = 1'000'000;
  return config;
}

TEST(FindPaths, BestOfATinyProblemIsThatOfEnumeration) {
  constexpr int kProblems = testing::Draws(36);
  Random random(1);
  Random mixer(2);
  int num_long = 0;
  double lost = 0.0;
  double lost_by_default = 0.0;
  for (int problem = 0; problem < kProblems; ++problem) {
    std::vector<Plot> plots = TinyProblem(&random);
    const int num_sensors = 1 + problem / 4 % 3;
    MixSensors(num_sensors, &mixer, &plots);
    const ScanSchedule scan_schedule = WatchOver(plots, num_sensors);
    TrackerConfig few_ways;
    const TrackerConfig all_ways = WithAllWays(few_ways);
    const Path expected = BestByEnumeration(plots, all_ways, num_sensors);
    const Path found = BestOf(plots, scan_schedule, all_ways);
    EXPECT_NEAR(found.score, expected.score, kScoreTolerance) << problem;
    if (!found.plots.empty()) {  // another one may be as good
      EXPECT_NEAR(PlainScore(plots, found.plots, all_ways, num_sensors, true), expected.score,
                  kScoreTolerance)
          << problem;
    }
    num_long += expected.plots.size() >= 4 ? 1 : 0;
    const double score = BestOf(plots, scan_schedule, few_ways).score;
    EXPECT_LE(score, found.score) << problem;
    lost_by_default += found.score - score;
    // Keeping a few ways to each plot loses next to nothing.
    few_ways.hypotheses_per_plot = 3;
    lost += found.score - BestOf(plots, scan_schedule, few_ways).score;
  }
  EXPECT_GT(num_long, kProblems / 3);
  EXPECT_LT(lost, 0.1 * kProblems);
  // Of the default's two ways, one that a new beginning surpasses after a pause may be the best.
  EXPECT_LT(lost_by_default, 0.4 * kProblems);
}

void ExpectPlainScores(const std::vector<Path>& paths, const std::vector<Plot>& plots,
                       const TrackerConfig& config) {
  for (const Path& path : paths) {
    EXPECT_NEAR(path.score,
                PlainScore(plots, path.plots, config, 1, false, TimeOutOfView::kLogUniform),
                kScoreTolerance);
  }
}

TEST(FindPaths, ScoresArePlainlyThoseOfTheModelAlsoOverLongGaps) {
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    Random random(seed);
    const Eigen::Vector3d velocity_mps = random.NormalVector(5.0);
    const Flight straight = [&](double t) -> Eigen::Vector3d {
      return Eigen::Vector3d(0, 10, 10) + velocity_mps * t;
    };
    std::vector<Plot> plots;
    AddFlight(straight, 60, 0.4, -9.0, &random, &plots);
    plots.erase(std::remove_if(plots.begin(), plots.end(),
                               [](const Plot& plot) {
                                 return plot.time_ns > kBeginNs + 20 * kPeriodNs &&
                                        plot.time_ns < kBeginNs + 45 * kPeriodNs;
                               }),
                plots.end());
    const TrackerConfig config;
    const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), config);
    ASSERT_FALSE(paths.empty()) << seed;
    ExpectPlainScores(paths, plots, config);
  }
}

TEST(FindPaths, ScoresArePlainlyThoseOfTheModelAlsoWhereTheTargetIsMoreAgileThanThat) {
  TrackerConfig config;
  config.sigma_a_mps2 = {1.0};
  std::size_t num_plots = 0;
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    Random random(seed);
    const Flight weaving = [](double t) -> Eigen::Vector3d {  // with 8 m/s^2
      return {15.0 + 2.0 * std::sin(2.0 * t), 3.0 * t, 10.0};
    };
    std::vector<Plot> plots;
    AddFlight(weaving, 80, 0.3, -9.0, &random, &plots);
    const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), config);
    ASSERT_FALSE(paths.empty()) << seed;
    ExpectPlainScores(paths, plots, config);
    for (const Path& path : paths) num_plots += path.plots.size();
  }
  EXPECT_GT(num_plots, 100U);
}

TEST(FindPaths, OnePathTakesAtMostOnePlotATimeAndNoPlotIsInTwo) {
  for (std::uint32_t seed = 0; seed < 5; ++seed) {
    Random random(seed);
    std::vector<Plot> plots;
    AddClutter(6.0, 60, {-6, 0, 0}, {6, 12, 12}, &random, &plots);
    AddFlight([](double t) { return Eigen::Vector3d(-6 + 2 * t, 6, 6); }, 60, 0.8, -6.0, &random,
              &plots);
    SortByTime(&plots);
    std::vector<char> used(plots.size(), 0);
    double score_before = std::numeric_limits<double>::infinity();
    for (const Path& path : FindPaths(plots, WatchOver(plots), TrackerConfig())) {
      EXPECT_LE(path.score, score_before);
      score_before = path.score;
      for (std::size_t k = 0; k < path.plots.size(); ++k) {
        EXPECT_EQ(used[path.plots[k]], 0);
        used[path.plots[k]] = 1;
        if (k == 0) continue;
        EXPECT_LT(plots[path.plots[k - 1]].time_ns, plots[path.plots[k]].time_ns);
      }
    }
  }
}

// The share of a path's plots that are of the flight from which most of them are.
double Purity(const Path& path, const std::vector<Plot>& plots,
              const std::vector<Flight>& flights) {
  double most = 0.0;
  for (const auto& at : flights) {
    double own = 0.0;
    for (const std::uint32_t i : path.plots) {
      const double time_s = testing::SecondsSinceBegin(plots[i].time_ns);
      const auto distance_m = [&](const Flight& flight) {
        return (flight(time_s) - plots[i].position_m).norm();
      };
      const bool is_nearest = std::all_of(flights.begin(), flights.end(), [&](const auto& other) {
        return distance_m(at) <= distance_m(other);
      });
      own += is_nearest ? 1.0 : 0.0;
    }
    most = std::max(most, own);
  }
  return most / static_cast<double>(path.plots.size());
}

TEST(FindPaths, CrossingTargetsKeepTheirOwnContinuation) {
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    Random random(seed);
    const double speed_mps = random.Uniform(2.0, 8.0);
    const std::vector<Flight> flights = {
        [=](double t) { return Eigen::Vector3d(speed_mps * (t - 3.0), 10.0, 10.0); },
        [=](double t) { return Eigen::Vector3d(0.2, 10.0, 10.2 + speed_mps * (t - 3.0)); }};
    std::vector<Plot> plots;
    for (const auto& at : flights) AddFlight(at, 60, 0.8, -9.0, &random, &plots);
    SortByTime(&plots);
    const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), TrackerConfig());
    ASSERT_EQ(paths.size(), 2U) << seed;
    for (const Path& path : paths) {
      EXPECT_GT(path.plots.size(), 40U) << seed;
      EXPECT_GT(Purity(path, plots, flights), 0.95) << seed;  // at the crossing either may be
    }
  }
}

TEST(FindPaths, TheRoughOnesHaveThePlotsOfTheTargetsAndHardlyAnyOthers) {
  for (std::uint32_t seed = 0; seed < 5; ++seed) {
    Random random(seed);
    std::vector<Plot> plots;
    AddClutter(10.0, 60, {-20, 5, 5}, {20, 45, 30}, &random, &plots);
    const double log_clutter = plots.front().log_clutter;
    SortByTime(&plots);
    const auto find = [&] {
      std::vector<Path> paths = FindPathsRoughly(plots, WatchOver(plots), TrackerConfig());
      EraseIf(&paths, [](const Path& path) { return path.score < kInitiationLog; });
      return paths;
    };
    EXPECT_TRUE(find().empty()) << seed;
    const std::vector<Flight> flights = {
        [](double t) { return Eigen::Vector3d(5.0 * (t - 3.0), 10.0, 10.0); },
        [](double t) { return Eigen::Vector3d(0.2, 30.0 + 2.0 * std::sin(t), 15.0); }};
    for (const auto& at : flights) AddFlight(at, 60, 0.8, log_clutter, &random, &plots);
    SortByTime(&plots);
    const std::vector<Path> paths = find();
    ASSERT_EQ(paths.size(), flights.size()) << seed;
    for (const Path& path : paths) {
      EXPECT_GT(path.plots.size(), 40U) << seed;
      EXPECT_GT(Purity(path, plots, flights), 0.95) << seed;
      const auto is_apart = [&](std::uint32_t i) {
        const double time_s = testing::SecondsSinceBegin(plots[i].time_ns);
        return std::all_of(flights.begin(), flights.end(), [&](const Flight& at) {
          return (plots[i].position_m - at(time_s)).norm() > 2.0;
        });
      };
      EXPECT_LE(std::count_if(path.plots.begin(), path.plots.end(), is_apart), 2) << seed;
    }
    ExpectPlainScores(paths, plots, TrackerConfig());
  }
}

TEST(FindPaths, AllOfASwarmAreFoundHoweverFewWeakPathsAreLookedAt) {
  constexpr int kTargets = 25;  // more than the weak paths that are looked at
  Random random(3);
  std::vector<Plot> plots;
  for (int i = 0; i < kTargets; ++i) {
    const Eigen::Vector3d from_m(-20.0 + 8.0 * (i % 5), 20.0, 5.0 + 8.0 * (i / 5));
    AddFlight(
        [=](double t) { return Eigen::Vector3d(from_m + 2.0 * t * Eigen::Vector3d::UnitY()); }, 30,
        0.8, -9.0, &random, &plots);
  }
  SortByTime(&plots);
  EXPECT_EQ(FindPaths(plots, WatchOver(plots), TrackerConfig()).size(), std::size_t{kTargets});
}

TEST(FindPaths, TheFlightIsFoundAmongClutter) {
  const auto at = [](double t) { return Eigen::Vector3d(-15 + 5 * t, 20, 15 + 2 * std::sin(t)); };
  for (std::uint32_t seed = 0; seed < 3; ++seed) {
    Random random(seed);
    std::vector<Plot> plots;
    AddClutter(10.0, 60, {-20, 5, 5}, {20, 45, 30}, &random, &plots);
    AddFlight(at, 60, 0.6, plots.front().log_clutter, &random, &plots);
    SortByTime(&plots);
    const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), TrackerConfig());
    ASSERT_FALSE(paths.empty());
    EXPECT_GT(paths[0].score, 60.0);
    std::size_t near = 0;
    for (const std::uint32_t i : paths[0].plots) {
      const double time_s = testing::SecondsSinceBegin(plots[i].time_ns);
      near += (plots[i].position_m - at(time_s)).norm() < 1.0 ? 1U : 0U;
    }
    EXPECT_GT(near, 25U);
    EXPECT_GE(near + 1, paths[0].plots.size());
  }
}

TEST(FindPaths, ATargetThatWasSeldomSeenAtFirstIsFollowedBackThroughClutterThatCrowdsItOut) {
  const auto at = [](double t) { return Eigen::Vector3d(-15 + 5 * t, 20, 15 + 2 * std::sin(t)); };
  constexpr int kSparse = 24;
  TrackerConfig config;
  config.max_hypotheses = 20;
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    Random random(seed);
    std::vector<Plot> plots;
    AddClutter(20.0, 60, {-20, 5, 5}, {20, 45, 30}, &random, &plots);
    const double log_clutter = plots.front().log_clutter;
    for (int i = 0; i < 60; i += i < kSparse ? 4 : 1) {
      plots.push_back(MakePlot(kBeginNs + i * kPeriodNs,
                               at(i * kPeriodS) + random.NormalVector(0.15), log_clutter, 3));
    }
    SortByTime(&plots);
    const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), config);
    ASSERT_FALSE(paths.empty()) << seed;
    std::size_t early = 0;
    for (const std::uint32_t i : paths[0].plots) {
      const double time_s = testing::SecondsSinceBegin(plots[i].time_ns);
      early += time_s < kSparse * kPeriodS && (plots[i].position_m - at(time_s)).norm() < 1.0;
    }
    EXPECT_GE(early, 5U) << seed;
  }
}

TEST(FindPaths, NothingIsCutOffBeforeAPauseWhereTheBeginningIsFollowedBack) {
  const auto at = [](double t) { return Eigen::Vector3d(-40 + 4 * t, 55, 30 + 4 * std::sin(t)); };
  constexpr int kFirstAfterPause = 94;
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    Random random(seed);
    std::vector<int> frames = {0, 7, 31, 55};
    for (int frame = kFirstAfterPause; frame < 200; frame += 2) frames.push_back(frame);
    std::vector<Plot> plots;
    plots.reserve(frames.size());
    for (const int frame : frames) {
      plots.push_back(MakePlot(kBeginNs + frame * kPeriodNs,
                               at(frame * kPeriodS) + random.NormalVector(0.15), -15.0));
    }
    const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), TrackerConfig());
    ASSERT_EQ(paths.size(), 1U) << seed;
    EXPECT_EQ(paths[0].plots.size(), plots.size()) << seed;
  }
}

TEST(FindPaths, UniformClutterReachesTheThresholdInHardlyAnyRecording) {
  // Expected at this threshold is one recording of a thousand: two of 200 are 1 in 50.
  constexpr double kFalseAlarms = 1e-3;
  int num_alarms = 0;
  for (int seed = 0; seed < testing::Draws(200); ++seed) {
    Random random(static_cast<std::uint32_t>(seed));
    std::vector<Plot> plots;
    AddClutter(random.Uniform(1.0, 8.0), 40, {-20, 5, 5}, {20, 45, 30}, &random, &plots);
    const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), TrackerConfig());
    const double threshold = std::log(static_cast<double>(plots.size()) / kFalseAlarms);
    if (!paths.empty() && paths[0].score >= threshold) ++num_alarms;
  }
  EXPECT_LE(num_alarms, 1);
}

TEST(FindPaths, ATargetWhosePlotsHaveTimesWithinTheFrameIsOnePathWithOnePlotAFrame) {
  // At 15 m/s it is 1.5 m farther at the end of a frame than at its begin.
  Random random(8);
  std::vector<Plot> plots;
  AddClutter(4.0, 60, {-10, 5, 5}, {10, 25, 25}, &random, &plots);
  for (Plot& plot : plots) {
    plot.time_ns += static_cast<TimeNs>(random.Index(100'000'000)) - kPeriodNs / 2;
  }
  const std::size_t num_clutter = plots.size();
  AddFlight([](double) { return Eigen::Vector3d(0, 15, 15); }, 60, 1.0, -7.0, &random, &plots);
  for (std::size_t i = num_clutter; i < plots.size(); ++i) {
    Plot& plot = plots[i];
    plot.time_ns += static_cast<TimeNs>(random.Index(100'000'000)) - kPeriodNs / 2;
    plot.position_m.x() += 15.0 * (testing::SecondsSinceBegin(plot.time_ns) - 3.0);
    plot.log_clutter = -7.5;
  }
  for (Plot& plot : plots) plot.streak_s = 0.0;
  SortByTime(&plots);
  const std::vector<Path> paths = FindPaths(plots, WatchOver(plots), TrackerConfig());
  ASSERT_FALSE(paths.empty());
  std::size_t num_own = 0;
  for (std::size_t k = 0; k < paths[0].plots.size(); ++k) {
    const Plot& plot = plots[paths[0].plots[k]];
    num_own += plot.log_clutter == -7.5 ? 1 : 0;
    EXPECT_TRUE(k == 0 || plots[paths[0].plots[k - 1]].frame < plot.frame);
  }
  EXPECT_GE(num_own, 58U);
  EXPECT_LE(paths[0].plots.size(), 60U);
}

struct Scenario {
  std::vector<Plot> plots;
  std::vector<Path> paths;
};

Scenario FlightInClutter() {
  Random random(5);
  Scenario scenario;
  AddClutter(4.0, 60, {-10, 5, 5}, {10, 25, 25}, &random, &scenario.plots);
  AddFlight([](double t) { return Eigen::Vector3d(-9 + 3 * t, 15, 15); }, 60, 0.7, -7.0, &random,
            &scenario.plots);
  AddFlight([](double t) { return Eigen::Vector3d(5, 20 - 2 * t, 10 + t); }, 60, 0.7, -7.0, &random,
            &scenario.plots);
  SortByTime(&scenario.plots);
  scenario.paths = FindPaths(scenario.plots, WatchOver(scenario.plots), TrackerConfig());
  return scenario;
}

void ExpectSamePaths(const std::vector<Path>& found, const std::vector<Path>& expected,
                     double tolerance) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(found[i].plots, expected[i].plots) << i;
    EXPECT_NEAR(found[i].score, expected[i].score, tolerance) << i;
  }
}

TEST(FindPaths, AreTheSameEachTimeAndAtAnyTimeOfDay) {
  Scenario scenario = FlightInClutter();
  ASSERT_GE(scenario.paths.size(), 2U);
  ExpectSamePaths(FindPaths(scenario.plots, WatchOver(scenario.plots), TrackerConfig()),
                  scenario.paths, 0.0);
  for (Plot& plot : scenario.plots) {
    plot.time_ns += 123'456'789'012'345;
    plot.frame_time_ns += 123'456'789'012'345;
  }
  ExpectSamePaths(FindPaths(scenario.plots, WatchOver(scenario.plots), TrackerConfig()),
                  scenario.paths, 0.0);
}

TEST(FindPaths, AreTheSameOnSeveralThreads) {
  const Scenario scenario = FlightInClutter();
  const testing::Threads several(4);
  ExpectSamePaths(FindPaths(scenario.plots, WatchOver(scenario.plots), TrackerConfig()),
                  scenario.paths, 0.0);
}

TEST(FindPaths, AreTheSameInAnyDirection) {
  Scenario scenario = FlightInClutter();
  Eigen::Matrix3d turn;  // x -> y -> z -> x
  turn << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  for (Plot& plot : scenario.plots) {
    plot.position_m = plot.ray_m = turn * plot.position_m;
  }
  ExpectSamePaths(FindPaths(scenario.plots, WatchOver(scenario.plots), TrackerConfig()),
                  scenario.paths, 1e-6);
}

TEST(FindPaths, OfNothingOrOfOnePlotAreNone) {
  EXPECT_TRUE(FindPaths({}, WatchOver({}), TrackerConfig()).empty());
  const std::vector<Plot> one = {MakePlot(kBeginNs, {1, 2, 3}, -9.0)};
  EXPECT_TRUE(FindPaths(one, WatchOver(one), TrackerConfig()).empty());
}

}  // namespace
}  // namespace unlidar
