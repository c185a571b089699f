// Bounds of the scores of a prediction and the plots of a frame.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tests/synthetic_plots.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodS;
using testing::Random;
using testing::RandomPlot;
using testing::WatchOver;

struct PredictedPlot {
  Hypothesis from;
  Motion motion;
  Prediction prediction;
  Plot plot;
};

// A plot near where a hypothesis expects one, or anywhere.
PredictedPlot RandomPrediction(const TrackModel& model, Random* random) {
  Plot first = RandomPlot(kBeginNs, random->InBox({-40, -40, 0}, {40, 40, 40}), random);
  first.sensor = 0;
  FrameTime at{0.0, {0, 0, 0}};
  const auto move_on = [&](double dt_s) {
    at.time_s += dt_s;
    at.frames_before[0] += static_cast<std::uint32_t>(std::ceil(dt_s / kPeriodS));
  };
  Hypothesis h = model.Birth(first, 0.0, at, random->Uniform(0.5, 10.0));
  for (std::uint32_t k = random->Index(5); k > 0; --k) {
    const double dt_s = random->Uniform(0.05, 0.5);
    move_on(dt_s);
    first.position_m += random->NormalVector(5.0 * dt_s);
    const Motion motion = model.MotionOver(dt_s);
    const Prediction p = model.Predict(h, model.PredictedScore(h, at), motion, at);
    h = model.Update(h, motion, p, first, at, model.ScoreIncrementOf(p, first));
  }
  const double dt_s = random->Uniform(0.05, 3.0);
  move_on(dt_s);
  const Motion motion = model.MotionOver(dt_s);
  const Prediction p = model.Predict(h, model.PredictedScore(h, at), motion, at);
  const double spread_m = std::sqrt(p.steady.position_m2) * random->Uniform(0.0, 10.0);
  return {h, motion, p,
          RandomPlot(kBeginNs, p.position_m + random->NormalVector(spread_m), random)};
}

ScoreBound BoundOf(const TrackModel& model, const PredictedPlot& at, const FrameBounds& frame) {
  const Prediction& p = at.prediction;
  const double score = p.score + p.log_detection_probability;
  ScoreBound bound = model.BoundOf(at.from.state, at.motion, p.steady, p.agile, frame,
                                   TopOf(score, p.steady, frame));
  const double agile_top = model.AgileTopOf(score, p.agile, frame);
  EXPECT_LE(agile_top, bound.agile_top + kRoundingSlack);
  bound.agile_top = agile_top;
  return bound;
}

TEST(ScoreBound, IsNeverLessThanTheScoreAndNearToItForASimplePlot) {
  Random random(3);
  const TrackerConfig config;
  double least_slack = 1e9;
  for (const int num_sensors : {1, 3}) {
    for (const double sigma_a_mps2 : config.sigma_a_mps2) {
      const TrackModel model(sigma_a_mps2, WatchOver({}, num_sensors), config);
      for (int i = 0; i < 2000; ++i) {
        const PredictedPlot at = RandomPrediction(model, &random);
        const Prediction& p = at.prediction;
        const Plot& plot = at.plot;
        const double score = p.score + model.ScoreIncrementOf(p, plot).log;
        const double distance2_m2 = (plot.position_m - p.position_m).squaredNorm();
        const double offset_s =
            std::abs(static_cast<double>(plot.time_ns - plot.frame_time_ns)) * 1e-9;
        const auto slack_of = [&](const FrameBounds& frame) {
          return BoundOf(model, at, frame).At(distance2_m2) - plot.log_clutter - score;
        };
        EXPECT_GE(slack_of({0.5 * plot.variance_m2, 2.0 * plot.variance_m2, plot.streak_s,
                            offset_s + random.Uniform(0.0, 0.05)}),
                  -1e-9);
        const double slack =
            slack_of({plot.variance_m2, plot.variance_m2, plot.streak_s, offset_s});
        EXPECT_GE(slack, -1e-9);
        least_slack = std::min(least_slack, slack);
      }
    }
  }
  EXPECT_LT(least_slack, 0.01);
}

TEST(ScoreBound, FallsWithDistance) {
  Random random(4);
  const TrackerConfig config;
  const TrackModel model(config.sigma_a_mps2.front(), WatchOver({}), config);
  for (int i = 0; i < 1000; ++i) {
    const PredictedPlot at = RandomPrediction(model, &random);
    const double half_span_s = i % 2 == 0 ? 0.0 : 0.05;
    const FrameBounds frame{0.01, 0.2, kPeriodS, half_span_s};
    const ScoreBound bound = BoundOf(model, at, frame);
    const double distance_m = random.Uniform(0.0, 20.0);
    EXPECT_LE(bound.At(1.01 * distance_m * distance_m), bound.At(distance_m * distance_m));
    EXPECT_LT(bound.At(1e4), bound.At(0.0));
  }
}

}  // namespace
}  // namespace unlidar
