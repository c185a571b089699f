#include "tracking/null_score.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/draws.hpp"
#include "tests/synthetic_plots.hpp"

namespace unlidar {
namespace {

using testing::AddClutter;
using testing::AddFlight;
using testing::kPeriodS;
using testing::Random;
using testing::RecordingMaker;
using testing::SortByTime;

constexpr int kFrames = 300;
// The search has six models: each plot may begin a path of each of them.
constexpr double kModels = 6.0;

Recording FramesOnly() {
  RecordingMaker maker(1);
  for (int i = 0; i < kFrames; ++i) maker.BeginFrame((i - 0.5) * kPeriodS);
  return maker.recording;
}

double BestScore(const std::vector<Plot>& plots) {
  return FindPaths(plots, ScanScheduleOf(FramesOnly()), TrackerConfig()).front().score;
}

double NullScoreOf(const std::vector<Plot>& plots) {
  const Recording recording = FramesOnly();
  return NullScore(recording, plots, std::vector<char>(plots.size(), 1), ScanScheduleOf(recording),
                   TrackerConfig());
}

std::vector<Plot> Clutter(Random* random) {
  std::vector<Plot> plots;
  AddClutter(4.0, kFrames, {-20, -20, 5}, {20, 20, 25}, random, &plots);
  return plots;
}

TEST(NullScore, OfClutterAsTheModelHasItIsWithinItsBound) {
  // Above ln(n m) + 3 with a probability of e^-3 at most, by Ville's inequality.
  int num_above = 0;
  const std::uint32_t draws = testing::Draws(40U);
  for (std::uint32_t seed = 0; seed < draws; ++seed) {
    Random random(seed);
    const std::vector<Plot> plots = Clutter(&random);
    const double bound = std::log(kModels * static_cast<double>(plots.size()));
    num_above += NullScoreOf(plots) > bound + 3.0 ? 1 : 0;
  }
  EXPECT_LE(num_above, draws / 10);
}

TEST(NullScore, NoMotionSurvivesIt) {
  Random random(5);
  std::vector<Plot> plots = Clutter(&random);
  AddFlight([](double t) { return Eigen::Vector3d(-18 + 1.2 * t, 0.5 * t, 10 + 0.3 * t); }, kFrames,
            0.4, -9.0, &random, &plots);
  SortByTime(&plots);
  EXPECT_GT(BestScore(plots), 200.0);
  EXPECT_LT(NullScoreOf(plots), 20.0);
}

TEST(NullScore, ShowsClutterThatIsRarerThanItIsHit) {
  // A twig that is hit in every fifth frame where the model has next to none.
  Random random(6);
  std::vector<Plot> plots = Clutter(&random);
  AddFlight([](double) { return Eigen::Vector3d(5, 5, 15); }, kFrames, 0.2, -9.0, &random, &plots);
  SortByTime(&plots);
  EXPECT_GT(NullScoreOf(plots), 30.0);
}

TEST(NullScore, IsThatOfTheClutterAloneAndTheSameEveryTime) {
  Random random(7);
  std::vector<Plot> plots = Clutter(&random);
  const std::size_t num_clutter = plots.size();
  AddFlight([](double) { return Eigen::Vector3d(5, 5, 15); }, kFrames, 0.2, -9.0, &random, &plots);
  std::vector<char> are_clutter(num_clutter, 1);
  are_clutter.resize(plots.size(), 0);
  const std::vector<Plot> alone(plots.begin(),
                                plots.begin() + static_cast<std::ptrdiff_t>(num_clutter));
  const Recording recording = FramesOnly();
  const ScanSchedule scan_schedule = ScanScheduleOf(recording);
  EXPECT_EQ(NullScore(recording, plots, are_clutter, scan_schedule, TrackerConfig()),
            NullScoreOf(alone));
  EXPECT_EQ(NullScoreOf(alone), NullScoreOf(alone));
  EXPECT_EQ(NullScoreOf({}), 0.0);
}

}  // namespace
}  // namespace unlidar
