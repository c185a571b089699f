#include "tracking/track_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/draws.hpp"
#include "tests/synthetic_plots.hpp"
#include "tests/tracker_oracle.hpp"
#include "tracking/path_exchange.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::kScoreTolerance;
using testing::MakePlot;
using testing::MixSensors;
using testing::PlainLogBirths;
using testing::PlainScore;
using testing::Random;
using testing::RandomPlot;
using testing::WatchOver;

// Plots at places and distances in time of all kinds, as no target would leave them.
std::vector<Plot> RandomPlots(std::size_t count, Random* random) {
  std::vector<Plot> plots;
  TimeNs time_ns = kBeginNs;
  Eigen::Vector3d position_m = random->InBox({-20, -20, 0}, {20, 20, 20});
  for (std::size_t i = 0; i < count; ++i) {
    plots.push_back(RandomPlot(time_ns, position_m, random));
    const auto pause = 1 + static_cast<TimeNs>(random->Index(random->Index(3) == 0 ? 150 : 4));
    time_ns += pause * kPeriodNs;
    position_m += random->NormalVector(0.1 + 0.3 * static_cast<double>(pause));
  }
  return plots;
}

double MeanOfExp(const std::vector<double>& logs) {
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(log);
  return sum / static_cast<double>(logs.size());
}

TEST(LogBirths, AreThoseOfThePlainModelAndOneOnAverage) {
  Random random(1);
  for (const double uniform : {1e-3, 0.1, 0.5, 1.0}) {
    TrackerConfig config;
    config.uniform_birth_share = uniform;
    const std::vector<Plot> plots = RandomPlots(100, &random);
    const std::vector<double> logs = LogBirths(plots, WatchOver(plots, 3), config);
    const std::vector<double> expected = PlainLogBirths(plots, config);
    ASSERT_EQ(logs.size(), plots.size());
    for (std::size_t i = 0; i < plots.size(); ++i) EXPECT_NEAR(logs[i], expected[i], 1e-9);
    EXPECT_NEAR(MeanOfExp(logs), 1.0, 1e-12);
    EXPECT_GE(*std::min_element(logs.begin(), logs.end()), std::log(uniform) - 1e-12);
  }
}

TEST(LogBirths, AreRarelyInClutterAndSeldomFarAway) {
  const TrackerConfig config;
  const std::vector<Plot> plots = {MakePlot(kBeginNs, {0, 10, 10}, -9.0),
                                   MakePlot(kBeginNs, {0, 10, 10}, -5.0),
                                   MakePlot(kBeginNs, {0, 80, 80}, -9.0)};
  const std::vector<double> logs = LogBirths(plots, WatchOver(plots), config);
  EXPECT_GT(logs[0], logs[1] + 1.0);
  EXPECT_GT(logs[0], logs[2] + 1.0);
}

TEST(LogBirths, DoNotOverflowWhereClutterIsOfAnyDensity) {
  std::vector<Plot> plots = {MakePlot(kBeginNs, {0, 10, 10}, -800.0),
                             MakePlot(kBeginNs, {0, 10, 10}, 800.0)};
  const std::vector<double> logs = LogBirths(plots, WatchOver(plots), TrackerConfig());
  EXPECT_NEAR(MeanOfExp(logs), 1.0, 1e-12);
  EXPECT_NEAR(logs[1], std::log(TrackerConfig().uniform_birth_share), 1e-12);
  EXPECT_TRUE(LogBirths({}, WatchOver({}), TrackerConfig()).empty());
}

TEST(TrackModel, TheNoiseOfAMotionHasNoSeam) {
  const TrackerConfig config;
  const TrackModel model(3.0, WatchOver({}), config);
  constexpr double kStep = 1.001;
  for (double dt_s = 1e-3; dt_s < 1.0; dt_s *= kStep) {
    const Eigen::Array33d before = model.MotionOver(dt_s).noise.array();
    const Eigen::Array33d after = model.MotionOver(kStep * dt_s).noise.array();
    for (Eigen::Index row = 0; row < 3; ++row) {
      for (Eigen::Index column = row; column < 3; ++column) {
        // The power of time with which it grows, a little less as acceleration decays.
        const auto power = static_cast<double>(5 - row - column);
        const double growth = (after(row, column) / before(row, column) - 1.0) / (kStep - 1.0);
        EXPECT_NEAR(growth, power, 0.6) << dt_s << ' ' << row << ' ' << column;
      }
    }
  }
}

TEST(PathScorer, ScoresAnySequenceAsThePlainModelDoes) {
  TrackerConfig config;
  config.max_speed_mps = 1e3;  // a limit of the search
  for (std::uint32_t seed = 0; seed < testing::Draws(30U); ++seed) {
    Random random(seed);
    std::vector<Plot> plots = RandomPlots(12, &random);
    const int num_sensors = 1 + static_cast<int>(seed % 3);
    MixSensors(num_sensors, &random, &plots);
    std::vector<std::uint32_t> members;
    for (std::uint32_t i = 0; i < plots.size(); ++i) {
      if (members.empty() || random.Index(4) != 0) members.push_back(i);
    }
    const ScanSchedule scan_schedule = WatchOver(plots, num_sensors);
    const std::vector<double> log_births = LogBirths(plots, scan_schedule, config);
    const Path path = PathScorer(plots, log_births, scan_schedule, config).WithScore(members);
    EXPECT_EQ(path.plots, members);
    const double expected = PlainScore(plots, members, config, num_sensors);
    EXPECT_NEAR(path.score, expected, kScoreTolerance + 1e-5 * std::abs(expected)) << seed;
  }
}

TEST(PathScorer, TwoPlotsOfOneFrameAreNoPath) {
  std::vector<Plot> plots;
  for (int i = 0; i < 5; ++i) {
    plots.push_back(MakePlot(kBeginNs + i * kPeriodNs, {0.1 * i, 10, 10}, -9.0));
  }
  plots.push_back(plots.back());  // of the same frame, a little later in it
  plots.back().time_ns += kPeriodNs / 4;
  const TrackerConfig config;
  const ScanSchedule scan_schedule = WatchOver(plots);
  const std::vector<double> log_births(plots.size(), 0.0);
  const PathScorer scorer(plots, log_births, scan_schedule, config);
  EXPECT_GT(scorer.WithScore({0, 1, 2, 3, 4}).score, 0.0);
  EXPECT_GT(scorer.WithScore({0, 1, 2, 3, 5}).score, 0.0);
  EXPECT_EQ(scorer.WithScore({0, 1, 2, 3, 4, 5}).score, -std::numeric_limits<double>::infinity());
}

TEST(PathScorer, OnlyFramesThatWereTakenCanMissATarget) {
  std::vector<Plot> plots;
  for (const int frame : {0, 1, 2, 3, 33, 34, 35, 36}) {
    plots.push_back(MakePlot(kBeginNs + frame * kPeriodNs, {0.1 * frame, 10, 10}, -9.0));
  }
  const TrackerConfig config;
  const std::vector<std::uint32_t> all = {0, 1, 2, 3, 4, 5, 6, 7};
  const std::vector<double> log_births(plots.size(), 0.0);
  const ScanSchedule watched = WatchOver(plots);
  ScanSchedule paused = watched;  // the recorder stood still between the plots
  std::vector<TimeNs>& times_ns = paused.sensors[0].frame_times_ns;
  times_ns.erase(times_ns.begin() + 4, times_ns.begin() + 33);
  const double score_watched = PathScorer(plots, log_births, watched, config).WithScore(all).score;
  const double score_paused = PathScorer(plots, log_births, paused, config).WithScore(all).score;
  EXPECT_GT(score_paused, score_watched + 5.0);
}

TEST(TrackModel, GoingUndetectedForAnyTimeIsNoLessLikelyThanBeingOutOfViewForIt) {
  std::vector<Plot> plots;
  for (int k = 0; k < 8; ++k) {
    plots.push_back(MakePlot(kBeginNs + k * kPeriodNs, {0.1 * k, 10, 10}, -9.0));
  }
  const ScanSchedule watched = WatchOver(plots);
  TrackerConfig config;
  config.out_of_view_probability = 0.1;
  Hypothesis h;
  FrameTime at;
  const TrackModel always_in_view(3.0, watched, config);
  const TrackModel model(3.0, watched, config, TimeOutOfView::kLogUniform);
  for (const Plot& plot : plots) {
    at = FrameTimeOf(plot, plots.front().frame_time_ns, watched);
    h = plot.time_ns == plots.front().time_ns ? always_in_view.Birth(plot, 0.0, at, 1.0)
                                              : always_in_view.PredictAndUpdate(h, plot, at);
  }
  const double log_max_frames = std::log(config.max_gap_s / kPeriodS) + 0.5772;
  int num_out_of_view = 0;
  for (std::uint32_t missed = 1; missed < 100; ++missed) {
    at.frames_before[0] = h.frames + missed;
    const double log_missed = always_in_view.ScoreAfterMisses(h, at) - h.score;
    const double log_out_of_view =
        std::log(config.out_of_view_probability / (missed * log_max_frames));
    EXPECT_DOUBLE_EQ(model.ScoreAfterMisses(h, at),
                     h.score + std::max(log_out_of_view, log_missed));
    num_out_of_view += log_missed < log_out_of_view ? 1 : 0;
  }
  EXPECT_GT(num_out_of_view, 30);
  EXPECT_LT(num_out_of_view, 99);
}

TEST(TrackModel, AllTimesOutOfViewTogetherHaveItsProbabilityInAScoreToBeJudged) {
  const std::vector<Plot> plots = {MakePlot(kBeginNs, {0, 10, 10}, -9.0),
                                   MakePlot(kBeginNs + kPeriodNs, {0, 10, 10}, -9.0)};
  const ScanSchedule watched = WatchOver(plots);
  TrackerConfig config;
  config.out_of_view_probability = 0.1;
  config.return_rate_m2_per_s = 1e9;  // in view, it is never missed
  const TrackModel judged(3.0, watched, config, TimeOutOfView::kLogUniform);
  FrameTime at = FrameTimeOf(plots[0], plots[0].frame_time_ns, watched);
  const Hypothesis h = judged.Birth(plots[0], 0.0, at, 1.0);
  double sum = 0.0;
  const int max_frames = static_cast<int>(std::round(config.max_gap_s / kPeriodS));
  for (int missed = 1; missed <= max_frames; ++missed) {
    at.frames_before[0] = h.frames + static_cast<std::uint32_t>(missed);
    const double log_probability = judged.ScoreAfterMisses(h, at) - h.score;
    sum += std::exp(log_probability);
  }
  EXPECT_NEAR(sum, config.out_of_view_probability, 0.002);
}

TEST(PathScorer, FramesOfTheSameInstantAreNotMissed) {
  // Two sensors in step see the same target: what the second one shows is more evidence.
  std::vector<Plot> plots;
  for (std::uint32_t i = 0; i < 8; ++i) {
    for (const std::uint32_t sensor : {0U, 1U}) {
      plots.push_back(MakePlot(kBeginNs + i * kPeriodNs, {0.1 * i, 10, 10}, -9.0));
      plots.back().sensor = sensor;
      plots.back().frame = 2 * i + sensor;
    }
  }
  const TrackerConfig config;
  const std::vector<double> log_births(plots.size(), 0.0);
  const PathScorer scorer(plots, log_births, WatchOver(plots, 2), config);
  std::vector<std::uint32_t> all;
  std::vector<std::uint32_t> first;
  for (std::uint32_t k = 0; k < plots.size(); ++k) {
    all.push_back(k);
    if (plots[k].sensor == 0) first.push_back(k);
  }
  EXPECT_GT(scorer.WithScore(all).score, scorer.WithScore(first).score + 20.0);
}

TEST(LogBirths, AndVisibilityAreThoseOfTheRangeFromTheSensor) {
  const TrackerConfig config;
  const Eigen::Vector3d origin_m(300.0, -40.0, 2.0);
  std::vector<Plot> plots = {MakePlot(kBeginNs, {0, 60, 60}, -9.0),
                             MakePlot(kBeginNs, {0, 10, 10}, -9.0)};
  const ScanSchedule scan_schedule = WatchOver(plots);
  std::vector<Plot> moved = plots;
  for (Plot& plot : moved) plot.position_m += origin_m;
  const TrackModel model(1.0, scan_schedule, config);
  for (std::size_t i = 0; i < plots.size(); ++i) {
    EXPECT_DOUBLE_EQ(LogBirthOdds(moved[i], scan_schedule, config),
                     LogBirthOdds(plots[i], scan_schedule, config));
    const auto log_detection_probability = [&](const Plot& plot) {
      return model.Birth(plot, 0.0, FrameTimeOf(plot, plot.frame_time_ns, scan_schedule), 1.0)
          .log_detection_probability;
    };
    EXPECT_DOUBLE_EQ(log_detection_probability(moved[i]), log_detection_probability(plots[i]));
  }
}

TEST(LogBirths, ExpectReturnsByTheSecondWhateverTheFrameRate) {
  // Half as long frames hold half as many returns: far away, where one is rare, half the chance.
  const TrackerConfig config;
  const std::vector<Plot> plots = {MakePlot(kBeginNs, {0, 600, 600}, -9.0)};
  const auto chance = [&](double frame_s) {
    ScanSchedule scan_schedule = WatchOver(plots);
    scan_schedule.sensors[0].frame_s = frame_s;
    const TrackModel model(1.0, scan_schedule, config);
    return std::exp(model.Birth(plots[0], 0.0, {0.0, {0}}, 1.0).log_detection_probability);
  };
  EXPECT_NEAR(chance(0.1) / chance(0.05), 2.0, 1e-3);
}

TEST(PathScorer, TheEmptyPathIsWorthNothing) {
  const std::vector<Plot> plots;
  const std::vector<double> log_births;
  const TrackerConfig config;
  EXPECT_EQ(PathScorer(plots, log_births, WatchOver({}), config).WithScore({}).score, 0.0);
}

}  // namespace
}  // namespace unlidar
