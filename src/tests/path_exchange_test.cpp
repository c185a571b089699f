// What it takes to let paths exchange tails, however many there are.
#include "tracking/path_exchange.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

#include "tests/synthetic_plots.hpp"

namespace unlidar {
namespace {

using testing::AddClutter;
using testing::AddFlight;
using testing::Random;
using testing::SortByTime;
using testing::WatchOver;

constexpr double kRange_m = 600.0;

// Pairs of targets that cross, at one range, each pair farther from the others than a target flies
// in that time, with strays about them.
std::vector<Plot> Crossings(int num_pairs) {
  std::vector<Plot> plots;
  for (int pair = 0; pair < num_pairs; ++pair) {
    const double azimuth = 0.5 * pair;
    const Eigen::Vector3d at_m(kRange_m * std::cos(azimuth), kRange_m * std::sin(azimuth), 10.0);
    Random random(2);
    for (const Eigen::Vector3d& velocity_mps :
         {Eigen::Vector3d(5, 0, 0), Eigen::Vector3d(0, 0, 5)}) {
      AddFlight([&](double t) { return Eigen::Vector3d(at_m + velocity_mps * (t - 3.0)); }, 60, 0.8,
                -9.0, &random, &plots);
    }
    AddClutter(0.5, 60, at_m.array() - 10.0, at_m.array() + 10.0, &random, &plots);
  }
  SortByTime(&plots);
  return plots;
}

// To the bit: what the filters know of the head is not computed again.
TEST(PathScorer, AHeadAndATailHaveTheScoreOfTheWholePath) {
  const std::vector<Plot> plots = Crossings(1);
  const TrackerConfig config;
  const ScanSchedule scan_schedule = WatchOver(plots);
  const std::vector<double> log_births = LogBirths(plots, scan_schedule, config);
  const PathScorer scorer(plots, log_births, scan_schedule, config);
  Random random(5);
  int num_of_one_frame = 0;
  for (int draw = 0; draw < 100; ++draw) {
    std::vector<std::uint32_t> head;
    std::vector<std::uint32_t> tail;
    for (std::uint32_t i = 0; i < plots.size(); ++i) {
      std::vector<std::uint32_t>& path = random.Index(2) == 0 ? head : tail;
      if (path.empty() || plots[path.back()].frame != plots[i].frame) path.push_back(i);
    }
    const PathScorer::Filtered of_head = scorer.Filter(head);
    const PathScorer::Filtered of_tail = scorer.Filter(tail);
    const std::size_t count = random.Index(static_cast<std::uint32_t>(head.size()) + 1);
    const auto begin =
        count == 0 ? tail.begin() : std::upper_bound(tail.begin(), tail.end(), head[count - 1]);
    std::vector<std::uint32_t> whole(head.begin(),
                                     head.begin() + static_cast<std::ptrdiff_t>(count));
    whole.insert(whole.end(), begin, tail.end());
    const Path path =
        scorer.WithScore(of_head, count, of_tail, static_cast<std::size_t>(begin - tail.begin()));
    const Path expected = scorer.WithScore(whole);
    EXPECT_EQ(path.plots, whole);
    EXPECT_EQ(path.score, expected.score);
    num_of_one_frame += std::isinf(expected.score) ? 1 : 0;
  }
  EXPECT_GT(num_of_one_frame, 0);
  EXPECT_LT(num_of_one_frame, 100);
}

TEST(PathExchange, TakesInProportionToTheNumberOfPlaces) {
  const auto effort_for = [](int num_pairs) {
    const std::vector<Plot> plots = Crossings(num_pairs);
    TrackerConfig config;
    config.return_rate_m2_per_s = 10.0 * kRange_m * kRange_m;
    Effort effort;
    EXPECT_EQ(FindPaths(plots, WatchOver(plots), config, &effort).size(),
              2U * static_cast<std::size_t>(num_pairs));
    return effort;
  };
  const Effort one = effort_for(1);
  const Effort many = effort_for(12);
  EXPECT_GT(one.plots_searched_again, 0U);
  EXPECT_EQ(many.pairs_compared, 12 * one.pairs_compared);
  EXPECT_EQ(many.plots_searched_again, 12 * one.plots_searched_again);
}

std::vector<std::uint32_t> Without(std::size_t first, std::size_t last,
                                   std::vector<std::uint32_t> plots) {
  plots.erase(plots.begin() + static_cast<std::ptrdiff_t>(first),
              plots.begin() + static_cast<std::ptrdiff_t>(last));
  return plots;
}

// Two wrong plots a second apart support each other: without either alone the score is lower.
TEST(DropStretch, TakesWhatSupportsItselfTogether) {
  const auto with_score = [](std::vector<std::uint32_t> plots) {
    const auto gone = 6 - plots.size();  // the first two together, or any others
    return Path{std::move(plots), gone == 0 ? 10.0 : gone == 2 ? 20.0 : 5.0};
  };
  Path path = with_score({0, 1, 2, 3, 4, 5});
  const auto time_of = [](std::uint32_t plot) {
    return static_cast<TimeNs>(plot < 2 ? plot : 2) * 1'000'000'000 + plot * 100'000'000;
  };
  const auto without = [&](std::size_t first, std::size_t last) {
    return with_score(Without(first, last, path.plots));
  };
  EXPECT_FALSE(DropStretch(time_of, without, Droppable::kRun, &path));
  EXPECT_TRUE(DropStretch(time_of, without, Droppable::kRunsBeforeLast, &path));
  EXPECT_EQ(path.plots, (std::vector<std::uint32_t>{2, 3, 4, 5}));
  EXPECT_EQ(path.score, 20.0);
}

// Plots of a flight that is seen in a third of the frames and goes on `aside_m` from its way after
// frames 30 to 49, a pause.
std::vector<Plot> PlotsBesideAPause(double aside_m) {
  Random random(3);
  std::vector<Plot> plots;
  AddFlight([&](double t) { return Eigen::Vector3d(3.0 * t, t < 4.0 ? 0.0 : aside_m, 50.0); }, 120,
            0.35, -9.0, &random, &plots);
  const auto is_in_pause = [](const Plot& plot) { return plot.frame >= 30 && plot.frame < 50; };
  plots.erase(std::remove_if(plots.begin(), plots.end(), is_in_pause), plots.end());
  return plots;
}

// The same, as a recording joins paths.
struct ScoredBesideAPause {
  explicit ScoredBesideAPause(double aside_m) : plots(PlotsBesideAPause(aside_m)) {
    std::iota(all.begin(), all.end(), 0U);
  }

  const TrackerConfig config;
  const std::vector<Plot> plots;
  const ScanSchedule scan_schedule = WatchOver(plots);
  const std::vector<double> log_births = LogBirths(plots, scan_schedule, config);
  const PathScorer scorer{plots, log_births, scan_schedule, config, TimeOutOfView::kLogUniform};
  std::vector<std::uint32_t> all = std::vector<std::uint32_t>(plots.size());
  const std::ptrdiff_t num_before =
      std::count_if(plots.begin(), plots.end(), [](const Plot& p) { return p.frame < 30; });
};

// Two parts of a flight that is seen in a third of the frames, with a pause of two seconds between
// them, are one target's, those of two flights are not, nor what hardly tells of any target.
TEST(IsOneTarget, IsTrueOfAFlightAndFalseOfTwo) {
  for (const double aside_m : {0.0, 60.0}) {
    const ScoredBesideAPause flight(aside_m);
    Path path;
    path.plots = flight.all;
    const auto num_before = static_cast<std::size_t>(flight.num_before);
    EXPECT_EQ(IsOneTarget(flight.scorer, path, num_before), aside_m == 0.0) << aside_m;
    path.plots = {0, path.plots.back()};
    EXPECT_FALSE(IsOneTarget(flight.scorer, path, 1)) << aside_m;
  }
}

// A walker and then a drone, or a drone and then a walker, two seconds apart: only the drone stays,
// and what is one target keeps both.
TEST(CutAtPauses, LeavesTheDroneOfAPathThatCameFromAWalker) {
  for (const double aside_m : {0.0, 60.0}) {
    const ScoredBesideAPause flight(aside_m);
    const std::vector<std::uint32_t>& all = flight.all;
    const auto middle = all.begin() + flight.num_before;
    const std::vector<std::uint32_t> before(all.begin(), middle);
    const std::vector<std::uint32_t> after(middle, all.end());
    const auto left_of = [&](OtherSide other) {
      Path path = flight.scorer.WithScore(all);
      const bool is_cut = CutAtPauses(
          flight.scorer, [&](const auto& /*before*/, const auto& /*after*/) { return other; },
          &path);
      EXPECT_EQ(is_cut, path.plots != all);
      return path.plots;
    };
    EXPECT_EQ(left_of(OtherSide::kBefore), aside_m > 0.0 ? after : all);
    EXPECT_EQ(left_of(OtherSide::kAfter), aside_m > 0.0 ? before : all);
    EXPECT_EQ(left_of(OtherSide::kNone), all);
  }
}

// Scores drawn for each set of plots: the best of all stretches that begin and end at a pause or at
// an end of the path, of at most six plots. Single runs have no pause within, several keep the last
// plot.
TEST(DropStretch, FindsTheBestOfAllStretches) {
  Random random(8);
  for (const Droppable droppable : {Droppable::kRun, Droppable::kRunsBeforeLast}) {
    int num_changed = 0;
    for (int draw = 0; draw < 300; ++draw) {
      const auto count = 2 + random.Index(9);
      std::vector<TimeNs> times_ns = {0};
      while (times_ns.size() < count) {
        times_ns.push_back(times_ns.back() + (random.Index(2) == 0 ? 100'000'000 : 500'000'000));
      }
      std::map<std::vector<std::uint32_t>, double> scores;
      const auto with_score = [&](std::vector<std::uint32_t> plots) {
        const double score = scores.try_emplace(plots, random.Uniform(0.0, 5.0)).first->second;
        return Path{std::move(plots), score};
      };
      std::vector<std::uint32_t> all(count);
      std::iota(all.begin(), all.end(), 0U);
      Path path = with_score(all);
      Path best = path;
      const auto is_pause = [&](std::size_t i) {
        return i == 0 || i == count || times_ns[i] - times_ns[i - 1] == 500'000'000;
      };
      for (std::size_t first = 0; first < count; ++first) {
        for (std::size_t last = first + 1; last <= count; ++last) {
          if (!is_pause(first) || !is_pause(last) || last - first > 6 || last - first == count)
            continue;
          bool has_pause_within = false;
          for (std::size_t i = first + 1; i < last; ++i) has_pause_within |= is_pause(i);
          if (droppable == Droppable::kRun ? has_pause_within : last == count) continue;
          const Path rest = with_score(Without(first, last, all));
          if (rest.score > best.score) best = rest;
        }
      }
      const bool is_better = best.score > path.score + kMinExchangeLog;
      const Path before = path;
      const auto time_of = [&](std::uint32_t i) { return times_ns[i]; };
      const auto without = [&](std::size_t first, std::size_t last) {
        return with_score(Without(first, last, all));
      };
      EXPECT_EQ(DropStretch(time_of, without, droppable, &path), is_better);
      EXPECT_EQ(path.plots, is_better ? best.plots : before.plots);
      num_changed += is_better ? 1 : 0;
    }
    EXPECT_GT(num_changed, 100);
  }
}

}  // namespace
}  // namespace unlidar
