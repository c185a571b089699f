#include "robust/track_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "robust/path_exchange.hpp"
#include "synthetic_plots.hpp"
#include "tracker_oracle.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::kScoreTolerance;
using testing::kWatch;
using testing::MakePlot;
using testing::MixSensors;
using testing::PlainLogBirths;
using testing::PlainScore;
using testing::Random;

Plot RandomPlot(TimeNs time_ns, const Eigen::Vector3d& position_m, Random* random) {
  Plot plot = MakePlot(time_ns, position_m, random->Uniform(-10.0, 0.0), 1 + random->Index(20));
  plot.variance_m2 = random->Uniform(0.005, 0.2);
  plot.sensor = random->Index(3);
  return plot;
}

// Plots at places and distances in time of all kinds, as no target would leave them.
std::vector<Plot> RandomPlots(std::size_t count, Random* random) {
  std::vector<Plot> plots;
  TimeNs time_ns = kBeginNs;
  Eigen::Vector3d position_m = random->InBox({-20, -20, 0}, {20, 20, 20});
  for (std::size_t i = 0; i < count; ++i) {
    plots.push_back(RandomPlot(time_ns, position_m, random));
    const auto pause = 1 + static_cast<TimeNs>(random->Index(random->Index(3) == 0 ? 150 : 4));
    time_ns += pause * kPeriodNs + static_cast<TimeNs>(random->Index(20'000'000));
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
  for (const double even : {1e-3, 0.1, 0.5, 1.0}) {
    TrackerConfig config;
    config.even_birth_share = even;
    config.echo_shape = random.Uniform(0.5, 3.0);
    const std::vector<Plot> plots = RandomPlots(100, &random);
    const std::vector<double> logs = LogBirths(plots, config);
    const std::vector<double> expected = PlainLogBirths(plots, config);
    ASSERT_EQ(logs.size(), plots.size());
    for (std::size_t i = 0; i < plots.size(); ++i) EXPECT_NEAR(logs[i], expected[i], 1e-9);
    EXPECT_NEAR(MeanOfExp(logs), 1.0, 1e-12);
    EXPECT_GE(*std::min_element(logs.begin(), logs.end()), std::log(even) - 1e-12);
  }
}

TEST(LogBirths, AreRarelyInClutterAndSeldomFarAway) {
  const TrackerConfig config;
  const std::vector<Plot> plots = {MakePlot(kBeginNs, {0, 10, 10}, -9.0),
                                   MakePlot(kBeginNs, {0, 10, 10}, -5.0),
                                   MakePlot(kBeginNs, {0, 80, 80}, -9.0)};
  const std::vector<double> logs = LogBirths(plots, config);
  EXPECT_GT(logs[0], logs[1] + 1.0);
  EXPECT_GT(logs[0], logs[2] + 1.0);
}

TEST(LogBirths, DoNotOverflowWhereClutterIsOfAnyDensity) {
  std::vector<Plot> plots = {MakePlot(kBeginNs, {0, 10, 10}, -800.0),
                             MakePlot(kBeginNs, {0, 10, 10}, 800.0)};
  const std::vector<double> logs = LogBirths(plots, TrackerConfig());
  EXPECT_NEAR(MeanOfExp(logs), 1.0, 1e-12);
  EXPECT_NEAR(logs[1], std::log(TrackerConfig().even_birth_share), 1e-12);
  EXPECT_TRUE(LogBirths({}, TrackerConfig()).empty());
}

TEST(TrackModel, TheNoiseOfAMotionHasNoSeam) {
  const TrackerConfig config;
  const TrackModel model(3.0, kWatch, config);
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
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    Random random(seed);
    std::vector<Plot> plots = RandomPlots(12, &random);
    const int num_sensors = 1 + static_cast<int>(seed % 3);
    MixSensors(num_sensors, &random, &plots);
    std::vector<std::uint32_t> members;
    for (std::uint32_t i = 0; i < plots.size(); ++i) {
      if (members.empty() || random.Index(4) != 0) members.push_back(i);
    }
    const std::vector<double> log_births = LogBirths(plots, config);
    const Path path =
        PathScorer(plots, log_births, Watch{kPeriodS, num_sensors}, config).Scored(members);
    EXPECT_EQ(path.plots, members);
    const double expected = PlainScore(plots, members, config, num_sensors);
    EXPECT_NEAR(path.score, expected, kScoreTolerance + 1e-5 * std::abs(expected)) << seed;
  }
}

TEST(PathScorer, TheEmptyPathIsWorthNothing) {
  const std::vector<Plot> plots;
  const std::vector<double> log_births;
  const TrackerConfig config;
  EXPECT_EQ(PathScorer(plots, log_births, kWatch, config).Scored({}).score, 0.0);
}

struct PredictedPlot {
  Prediction prediction;
  Plot plot;
};

// A plot near where a hypothesis expects one, or anywhere.
PredictedPlot RandomPrediction(const TrackModel& model, Random* random) {
  Plot first = RandomPlot(kBeginNs, random->InBox({-40, -40, 0}, {40, 40, 40}), random);
  Hypothesis h = model.Birth(first, 0.0, 0.0, random->Uniform(0.5, 10.0));
  double time_s = 0.0;
  for (std::uint32_t k = random->Index(5); k > 0; --k) {
    const double dt_s = random->Uniform(0.05, 0.5);
    time_s += dt_s;
    first.position_m += random->NormalVector(5.0 * dt_s);
    const Motion motion = model.MotionOver(dt_s);
    const Prediction p = model.Predict(h, model.ScoreUnseen(h, time_s), motion);
    h = model.Update(h, motion, p, first, time_s, model.GainOf(p, first));
  }
  const double dt_s = random->Uniform(0.05, 3.0);
  time_s += dt_s;
  const Prediction p = model.Predict(h, model.ScoreUnseen(h, time_s), model.MotionOver(dt_s));
  const double spread_m = std::sqrt(p.variance_m2) * random->Uniform(0.0, 10.0);
  return {p, RandomPlot(kBeginNs, p.position_m + random->NormalVector(spread_m), random)};
}

TEST(ScoreBound, IsNeverLessThanTheScoreAndNearToItForASimplePlot) {
  Random random(3);
  const TrackerConfig config;
  double least_slack = 1e9;
  for (const int num_sensors : {1, 3}) {
    for (const double sigma_a_mps2 : config.sigma_a_mps2) {
      const TrackModel model(sigma_a_mps2, Watch{kPeriodS, num_sensors}, config);
      for (int i = 0; i < 2000; ++i) {
        const PredictedPlot at = RandomPrediction(model, &random);
        const Prediction& p = at.prediction;
        const Plot& plot = at.plot;
        const double score = p.score + model.GainOf(p, plot).log;
        const double distance2_m2 = (plot.position_m - p.position_m).squaredNorm();
        const auto slack_of = [&](const VarianceRange& variances) {
          return model.BoundOf(p, variances).At(distance2_m2) - plot.log_clutter - score;
        };
        EXPECT_GE(slack_of({0.5 * plot.variance_m2, 2.0 * plot.variance_m2}), -1e-9);
        const double slack = slack_of({plot.variance_m2, plot.variance_m2});
        EXPECT_GE(slack, -1e-9);
        least_slack = std::min(least_slack, slack);
      }
    }
  }
  EXPECT_LT(least_slack, 0.01);
}

TEST(ScoreBound, BeyondItsReachItIsLess) {
  Random random(4);
  const TrackerConfig config;
  const TrackModel model(config.sigma_a_mps2.front(), kWatch, config);
  int num_reached = 0;
  for (int i = 0; i < 1000; ++i) {
    const PredictedPlot at = RandomPrediction(model, &random);
    const ScoreBound bound = model.BoundOf(at.prediction, {0.01, 0.2});
    const double score = at.prediction.score + random.Uniform(-20.0, 5.0);
    const double reach_m2 = bound.ReachM2(score);
    if (reach_m2 <= 0.0) {
      EXPECT_LE(bound.At(0.0), score);
      continue;
    }
    ++num_reached;
    EXPECT_NEAR(bound.At(reach_m2), score, 1e-6);
    EXPECT_LT(bound.At(1.01 * reach_m2), score);
  }
  EXPECT_GT(num_reached, 300);
}

}  // namespace
}  // namespace unlidar
