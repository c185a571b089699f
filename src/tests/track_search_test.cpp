#include "tracking/track_search.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "tests/synthetic_plots.hpp"

namespace unlidar {
namespace {

using testing::AddClutter;
using testing::AddFlight;
using testing::kBeginNs;
using testing::kPeriodNs;
using testing::MakePlot;
using testing::Random;
using testing::SortByTime;
using testing::WatchOver;

// The same search without bounds and neighbourhoods: every hypothesis is tried with every plot.
double BestScoreOfAllPairs(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                           const TrackModel& model, const TrackerConfig& config) {
  std::vector<Hypothesis> all;
  double best = 0.0;
  for (std::size_t first = 0, last = 0; first < plots.size(); first = last) {
    while (last < plots.size() && plots[last].frame == plots[first].frame) ++last;
    const FrameTime at = FrameTimeOf(plots[first], plots.front().frame_time_ns, WatchOver(plots));
    const std::size_t num_before = all.size();
    for (std::size_t i = first; i < last; ++i) {
      std::vector<Hypothesis> hypotheses;
      for (std::size_t k = 0; k < num_before; ++k) {
        const Hypothesis& from = all[k];
        const double unseen = model.PredictedScore(from, at);
        if (at.time_s - from.time_s > config.max_gap_s) continue;
        if (unseen < kDeletionLog) continue;
        const Motion motion = model.MotionOver(at.time_s - from.time_s);
        const Prediction p = model.Predict(from, unseen, motion, at);
        const ScoreIncrement increment = model.ScoreIncrementOf(p, plots[i]);
        const double score = p.score + increment.log;
        if (score < std::max(kDeletionLog, log_births[i] + kReinitiationLog)) continue;
        hypotheses.push_back(model.Update(from, motion, p, plots[i], at, increment));
      }
      std::stable_sort(hypotheses.begin(), hypotheses.end(),
                       [](const Hypothesis& a, const Hypothesis& b) { return a.score > b.score; });
      hypotheses.resize(
          std::min(hypotheses.size(), static_cast<std::size_t>(config.hypotheses_per_plot)));
      for (const Hypothesis& hypothesis : hypotheses) {
        if (hypothesis.state.mean.col(1).norm() > config.max_speed_mps) continue;
        all.push_back(hypothesis);
        if (hypothesis.num_plots >= static_cast<std::uint32_t>(kMinPathPlots))
          best = std::max(best, hypothesis.score);
      }
      for (const double speed_mps : config.birth_speeds_mps) {
        all.push_back(model.Birth(plots[i], log_births[i], at, speed_mps));
      }
    }
  }
  return best;
}

Path BestOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
            const std::vector<char>& free, const TrackModel& model, const TrackerConfig& config) {
  const std::vector<Scan> scans = ScansOf(plots, log_births, WatchOver(plots));
  return TrackSearch(log_births, scans, free, 0.0, model, config).Best();
}

// Two drones in clutter, with plots that differ.
std::vector<Plot> Scene(std::uint32_t seed, int num_frames) {
  Random random(seed);
  std::vector<Plot> plots;
  AddClutter(random.Uniform(1.0, 8.0), num_frames, {-10, 5, 5}, {10, 25, 25}, &random, &plots);
  AddFlight([](double t) { return Eigen::Vector3d(-9 + 4 * t, 15, 15); }, num_frames, 0.7, -7.0,
            &random, &plots);
  AddFlight([](double t) { return Eigen::Vector3d(5, 20 - 2 * t, 10 + t); }, num_frames, 0.3, -7.0,
            &random, &plots);
  for (Plot& plot : plots) {
    plot.variance_m2 *= random.Uniform(1.0, 5.0);
    plot.log_clutter += random.Uniform(-1.0, 1.0);
  }
  SortByTime(&plots);
  return plots;
}

TEST(TrackSearch, LooksAtEveryPairThatMatters) {
  TrackerConfig config;
  config.max_hypotheses = 1'000'000;
  config.max_gap_s = 1.5;
  for (std::uint32_t seed = 0; seed < 12; ++seed) {
    const std::vector<Plot> plots = Scene(seed, 40);
    const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
    const std::vector<char> free(plots.size(), 1);
    const TrackModel model(config.sigma_a_mps2[seed % 3], WatchOver({}), config);
    const Path path = BestOf(plots, log_births, free, model, config);
    EXPECT_NEAR(path.score, BestScoreOfAllPairs(plots, log_births, model, config), 1e-9) << seed;
    EXPECT_GT(path.score, 20.0) << seed;
  }
}

TEST(TrackSearch, LooksAtEveryPairThatIsJustGoodEnough) {
  // A few plots about as far apart as a path of them is worth something: in a long path one pair
  // that goes missing would hardly be noticed.
  TrackerConfig config;
  const TrackModel model(config.sigma_a_mps2.front(), WatchOver({}), config);
  Random random(9);
  int num_weak = 0;
  for (int scene = 0; scene < 6000; ++scene) {
    std::vector<Plot> plots;
    for (std::uint32_t i = 3 + random.Index(3); i > 0; --i) {
      const auto frame = static_cast<TimeNs>(random.Index(6));
      plots.push_back(MakePlot(kBeginNs + frame * kPeriodNs,
                               Eigen::Vector3d(5, 8, 8) + random.NormalVector(0.8),
                               random.Uniform(-8.0, 0.0), 1 + random.Index(8)));
      plots.back().variance_m2 = random.Uniform(0.005, 0.1);
    }
    SortByTime(&plots);
    const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
    const std::vector<char> free(plots.size(), 1);
    const double score = BestOf(plots, log_births, free, model, config).score;
    EXPECT_NEAR(score, BestScoreOfAllPairs(plots, log_births, model, config), 1e-9) << scene;
    num_weak += score > 0.0 && score < 1.0 ? 1 : 0;
  }
  EXPECT_GT(num_weak, 100);
}

TEST(TrackSearch, TheBestPathHoldsFreePlotsOnlyAlsoIfTheyWereTakenLater) {
  TrackerConfig config;
  config.hypotheses_per_plot = 3;  // with fewer, a search anew may have hidden other ones
  const std::vector<Plot> plots = Scene(1, 60);
  const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
  const TrackModel model(config.sigma_a_mps2[1], WatchOver({}), config);
  std::vector<char> free(plots.size(), 1);
  const std::vector<Scan> scans = ScansOf(plots, log_births, WatchOver(plots));
  TrackSearch search(log_births, scans, free, 0.0, model, config);
  double before = 1e9;
  int num_paths = 0;
  for (Path path = search.Best(); !path.plots.empty(); path = search.Best(), ++num_paths) {
    EXPECT_LE(path.score, before);
    EXPECT_GE(static_cast<int>(path.plots.size()), kMinPathPlots);
    before = path.score;
    for (const std::uint32_t i : path.plots) {
      ASSERT_EQ(free[i], 1);
      free[i] = 0;
    }
    // A search from anew may find what the first plots hid, never less.
    EXPECT_GE(BestOf(plots, log_births, free, model, config).score, search.Best().score - 1e-9);
  }
  EXPECT_GT(num_paths, 2);
}

// Takes the paths of a search above `min_score`, the best first.
std::vector<Path> TakePaths(const std::vector<Plot>& plots, double min_score,
                            const TrackerConfig& config) {
  const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
  const std::vector<Scan> scans = ScansOf(plots, log_births, WatchOver(plots));
  const TrackModel model(config.sigma_a_mps2[1], WatchOver({}), config);
  std::vector<char> free(plots.size(), 1);
  TrackSearch search(log_births, scans, free, min_score, model, config);
  std::vector<Path> paths;
  for (Path path = search.Best(); !path.plots.empty(); path = search.Best()) {
    for (const std::uint32_t i : path.plots) free[i] = 0;
    paths.push_back(std::move(path));
  }
  return paths;
}

TEST(TrackSearch, OfPathsAboveALimitTakesThoseThatASearchForAllTakesFirst) {
  const TrackerConfig config;
  std::size_t num_above = 0;
  for (std::uint32_t seed = 0; seed < 12; ++seed) {
    const std::vector<Plot> plots = Scene(seed, 60);
    const std::vector<Path> all = TakePaths(plots, 0.0, config);
    const std::vector<Path> above = TakePaths(plots, 3.0, config);
    ASSERT_LE(above.size(), all.size()) << seed;
    for (std::size_t k = 0; k < above.size(); ++k) {
      EXPECT_EQ(above[k].plots, all[k].plots) << seed;
      EXPECT_GT(above[k].score, 3.0) << seed;
    }
    if (above.size() < all.size()) {
      EXPECT_LE(all[above.size()].score, 3.0) << seed;
    }
    num_above += above.size();
  }
  EXPECT_GT(num_above, 24U);
}

TEST(TrackSearch, OfManyHypothesesFindsThePathThatOneThatDropsNoneFinds) {
  Random random(3);
  std::vector<Plot> plots;
  AddClutter(300.0, 60, {-40, 5, 5}, {40, 60, 60}, &random, &plots);
  AddFlight([](double t) { return Eigen::Vector3d(-9 + 4 * t, 15, 15); }, 60, 0.7, -7.0, &random,
            &plots);
  SortByTime(&plots);
  const TrackerConfig config;
  const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
  const std::vector<char> free(plots.size(), 1);
  const TrackModel model(config.sigma_a_mps2[1], WatchOver({}), config);
  // That of a stream keeps all hypotheses until it is told to forget.
  TrackSearch stream(log_births, free, model, config);
  Queue<Path> ends;
  for (const Scan& scan : ScansOf(plots, log_births, WatchOver(plots))) {
    stream.Extend(scan);
    stream.AppendPathsToLastScan(20.0, &ends);
  }
  ASSERT_GT(ends.size(), 10U);
  const auto best = std::max_element(
      ends.begin(), ends.end(), [](const Path& a, const Path& b) { return a.score < b.score; });
  const std::vector<Scan> scans = ScansOf(plots, log_births, WatchOver(plots));
  TrackSearch search(log_births, scans, free, 0.0, model, config);
  EXPECT_GT(stream.num_hypotheses(), 20 * search.num_hypotheses());
  const Path path = search.Best();
  EXPECT_EQ(path.plots, best->plots);
  EXPECT_EQ(path.score, best->score);
}

// Height of the lowest return of each plot of the best path to the last one of a stream.
std::vector<double> LowestOfLastPathM(const std::vector<Plot>& plots, double ground_target_m) {
  const TrackerConfig config;
  const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
  const std::vector<char> free(plots.size(), 1);
  const TrackModel model(config.sigma_a_mps2.back(), WatchOver({}), config);
  TrackSearch search(log_births, free, model, config, ground_target_m);
  const std::vector<Scan> scans = ScansOf(plots, log_births, WatchOver(plots));
  for (const Scan& scan : scans) search.Extend(scan);
  Queue<Path> paths;
  search.AppendPathsToLastScan(0.0, &paths);
  std::vector<double> lowest_m;
  for (const std::uint32_t i : paths.back().plots) lowest_m.push_back(plots[i].lowest_m);
  return lowest_m;
}

TEST(TrackSearch, AGroundTargetDoesNotGoOnAsADroneNearby) {
  // A car in every frame, and a drone 9 m from its way in one of four, last in the last.
  std::vector<Plot> plots;
  for (int i = 0; i <= 40; ++i) {
    const TimeNs time_ns = kBeginNs + i * kPeriodNs;
    if (i < 40) plots.push_back(MakePlot(time_ns, {0.6 * i - 12.0, 20.0, 0.5}, -9.0, 3));
    if (i % 4 == 0) plots.push_back(MakePlot(time_ns, {0.2 * i, 21.0, 9.0}, -9.0, 3));
  }
  for (Plot& plot : plots) plot.lowest_m = plot.position_m.z();
  EXPECT_EQ(LowestOfLastPathM(plots, 2.0), std::vector<double>(11, 9.0));
  EXPECT_EQ(LowestOfLastPathM(plots, kNoGroundTargetsM).front(), 0.5);
}

// First plot of the best path to the last one, of a target that is seen from 2 s on, `apart_m`
// beside another that has been seen all the time.
std::uint32_t FirstOfSecondTarget(double apart_m, const TrackerConfig& config) {
  std::vector<Plot> plots;
  for (int i = 0; i < 40; ++i) {
    const TimeNs time_ns = kBeginNs + i * kPeriodNs;
    plots.push_back(MakePlot(time_ns, {0.4 * i, 20.0, 5.0}, -12.0, 3));
    if (i >= 20) plots.push_back(MakePlot(time_ns, {0.4 * i, 20.0 + apart_m, 5.0}, -12.0, 3));
  }
  const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
  const std::vector<char> free(plots.size(), 1);
  const TrackModel model(config.sigma_a_mps2.back(), WatchOver({}), config);
  TrackSearch search(log_births, free, model, config, kNoGroundTargetsM, true);
  for (const Scan& scan : ScansOf(plots, log_births, WatchOver(plots))) search.Extend(scan);
  Queue<Path> paths;
  search.AppendPathsToLastScan(0.0, &paths);
  return paths.back().plots.front();
}

TEST(TrackSearch, AnEstablishedTargetTakesNoPlotsOfAnother) {
  constexpr std::uint32_t kOwnFirst = 21;
  TrackerConfig config;
  config.max_gap_s = 0.25;
  EXPECT_EQ(FirstOfSecondTarget(4.0, config), kOwnFirst);
  config.gate_sigmas = 1e6;
  EXPECT_EQ(FirstOfSecondTarget(4.0, config), 0U);
  // Ways that are faster than any may fly leave no room for those that are not.
  config.max_gap_s = 10.0;
  EXPECT_EQ(FirstOfSecondTarget(150.0, config), kOwnFirst);
}

TEST(TrackSearch, WhatTakesOffGoesOnFromTheGround) {
  std::vector<Plot> plots;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector3d at_m(0.1 * i, 20.0, 0.01 * i * i);
    plots.push_back(MakePlot(kBeginNs + i * kPeriodNs, at_m, -9.0, 3));
    plots.back().lowest_m = at_m.z();
  }
  EXPECT_EQ(LowestOfLastPathM(plots, 2.0).size(), plots.size());
}

TEST(TrackSearch, BirthsFarAwayDoNotCrowdOutAWeakPathNearby) {
  constexpr int kFrames = 120;
  constexpr int kStrays = 300;
  Random random(6);
  std::vector<Plot> plots;
  std::vector<Plot> own;
  for (int i = 0; i < kFrames; ++i) {
    const TimeNs time_ns = kBeginNs + i * kPeriodNs;
    for (int k = 0; k < kStrays; ++k) {
      const Eigen::Vector3d towards = random.NormalVector(1.0).normalized();
      plots.push_back(MakePlot(time_ns, random.Uniform(200.0, 600.0) * towards, -14.0));
    }
    if (i % 5 != 0) continue;  // at 28 m
    const Eigen::Vector3d at_m(20.0, 0.8 * (0.1 * i - 6.0), 19.6);
    plots.push_back(MakePlot(time_ns, at_m + random.NormalVector(0.1), -6.0));
    own.push_back(plots.back());
  }
  TrackerConfig config;
  config.max_hypotheses = 250;
  const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), config);
  const std::vector<char> free(plots.size(), 1);
  const TrackModel model(config.sigma_a_mps2.front(), WatchOver({}), config);
  const Path path = BestOf(plots, log_births, free, model, config);
  EXPECT_EQ(path.plots.size(), own.size());
  for (const std::uint32_t i : path.plots) EXPECT_LT(plots[i].position_m.norm(), 50.0);
  // As good as if there were nothing else, but for the first plot's share among all of them.
  const std::vector<double> own_births(own.size(), log_births[path.plots.front()]);
  const std::vector<char> own_free(own.size(), 1);
  const Path alone = BestOf(own, own_births, own_free, model, config);
  EXPECT_NEAR(path.score, alone.score, 1e-6);
}

TEST(TrackSearch, OfAFewBestHypothesesFindsNearlyWhatThatOfAllFinds) {
  const TrackerConfig all;
  TrackerConfig few = all;
  few.max_hypotheses = 20;
  for (std::uint32_t seed = 0; seed < 5; ++seed) {
    const std::vector<Plot> plots = Scene(seed, 60);
    const std::vector<double> log_births = LogBirths(plots, WatchOver(plots), all);
    const std::vector<char> free(plots.size(), 1);
    const auto score_of = [&](const TrackerConfig& config) {
      const TrackModel model(config.sigma_a_mps2[1], WatchOver({}), config);
      return BestOf(plots, log_births, free, model, config).score;
    };
    EXPECT_NEAR(score_of(few), score_of(all), 0.05 * score_of(all)) << seed;
  }
}

}  // namespace
}  // namespace unlidar
