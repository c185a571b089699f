#include "scene/floating.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/fitted_scene.hpp"
#include "tests/range_grid_oracle.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::BlockVolumeM3;
using testing::IsNeighbour;
using testing::RecordingMaker;

// Nothing is held by anything seen.
struct Sky {
  Ground ground;
  Support support{ground, SupportConfig()};
};

// Plots of a single return each, in order of time.
std::vector<Plot> PlotsOf(const Recording& recording) {
  std::vector<Plot> plots;
  for (std::uint32_t f = 0; f < recording.frames.size(); ++f) {
    const FrameInfo& frame = recording.frames[f];
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      Plot plot;
      plot.time_ns = plot.frame_time_ns = recording.times_ns[i];
      plot.position_m = recording.points_m[i].cast<double>();
      plot.frame = f;
      plot.returns = {i};
      plots.push_back(plot);
    }
  }
  return plots;
}

std::vector<char> FloatingOf(const Recording& recording, const RangeRadius& place) {
  std::vector<Plot> plots = PlotsOf(recording);
  RobustConfig config;
  config.background.place = place;
  MarkFloating(recording, Sky().support, config, &plots);
  std::vector<char> are_floating;
  for (const Plot& plot : plots) are_floating.push_back(plot.is_floating ? 1 : 0);
  return are_floating;
}

// The same, plot by plot against all others.
std::vector<char> FloatingByDefinition(const Recording& recording, const RangeRadius& place) {
  constexpr TimeNs kSameTimeNs = 300'000'000;
  const std::vector<Plot> plots = PlotsOf(recording);
  const SupportConfig config;
  const Sky sky;
  const auto at = [](const Plot& plot) { return plot.position_m.cast<float>().eval(); };
  const auto count_about = [&](const Plot& plot, const RangeRadius& radius) {
    double count = 0.0;
    for (const Plot& other : plots) count += IsNeighbour(radius, at(plot), at(other)) ? 1.0 : 0.0;
    return count;
  };
  const RangeRadius region{3.0 * place.constant_m, 3.0 * place.slope};
  std::vector<char> are_standing;
  for (const Plot& plot : plots) {
    const double here = count_about(plot, place);
    const double chance = count_about(plot, region) * BlockVolumeM3(place, at(plot)) /
                          BlockVolumeM3(region, at(plot));
    are_standing.push_back(here >= 3.0 && here > chance + 3.0 * std::sqrt(chance));
  }
  std::vector<char> seem_to_float;
  for (std::size_t i = 0; i < plots.size(); ++i) {
    seem_to_float.push_back(are_standing[i] != 0 && sky.support.IsFloating(at(plots[i])) ? 1 : 0);
  }
  // Of each plot: itself, beside, about.
  std::vector<std::array<double, 3>> tallies(plots.size());
  for (std::size_t i = 0; i < plots.size(); ++i) {
    if (seem_to_float[i] == 0) continue;
    const double reach_m = SupportReachM(plots[i].position_m.norm(), config);
    for (std::size_t k = 0; k < plots.size(); ++k) {
      if (are_standing[k] == 0) continue;
      if (std::abs(plots[k].time_ns - plots[i].time_ns) > kSameTimeNs) continue;
      const double distance_m = (plots[i].position_m - plots[k].position_m).norm();
      if (distance_m >= 5.0 * reach_m) continue;
      tallies[i][distance_m <= kObjectRadiusM ? 0 : distance_m < reach_m ? 1 : 2] += 1.0;
    }
  }
  std::vector<char> are_floating;
  for (std::size_t i = 0; i < plots.size(); ++i) {
    if (seem_to_float[i] == 0) {
      are_floating.push_back(0);
      continue;
    }
    double num_plots = 0.0;
    std::array<double, 3> sums{};
    for (std::size_t k = 0; k < plots.size(); ++k) {
      if (seem_to_float[k] == 0) continue;
      if (!IsNeighbour({kObjectRadiusM, 0.01}, at(plots[i]), at(plots[k]))) continue;
      num_plots += 1.0;
      for (std::size_t t = 0; t < sums.size(); ++t) sums[t] += tallies[k][t];
    }
    const double times = sums[0] / num_plots;
    const double chance = sums[2] / times / 124.0;
    const bool has_company = sums[1] / times > chance + 2.0 * std::sqrt(chance);
    are_floating.push_back(has_company ? 0 : 1);
  }
  return are_floating;
}

// Of the plots of a thing 20 m up that is seen in four frames, so many seconds apart, behind
// something that hides much of what is about it.
std::size_t NumFloatingOfThingSeenEvery(double apart_s, int num_frames = 600) {
  RecordingMaker maker(3);
  const Eigen::Vector3d thing_m(30, 0, 20);
  for (int i = 0; i < num_frames; ++i) {
    const double time_s = i * testing::kPeriodS;
    maker.BeginFrame(time_s);
    const double seen = (time_s - 10.0) / apart_s;
    if (std::abs(seen - std::round(seen)) * apart_s < 0.5 * testing::kPeriodS && seen > -0.5 &&
        seen < 3.5) {
      maker.Add(thing_m + maker.random.NormalVector(0.05));
    }
  }
  RecordingMaker scene(4);
  scene.BeginFrame(0.0);
  scene.AddGround(-1.5, 60.0, 20000);
  const Ground ground = GroundOf(scene.recording.points_m);
  scene.AddBox({15, -8, 2}, {15.2, -0.3, 20}, 20000);
  const Support support = SupportBy(scene.recording.points_m, ground, SupportConfig());
  std::vector<Plot> plots = PlotsOf(maker.recording);
  EXPECT_EQ(plots.size(), 4U);
  MarkFloating(maker.recording, support, RobustConfig(), &plots);
  return static_cast<std::size_t>(
      std::count_if(plots.begin(), plots.end(), [](const Plot& plot) { return plot.is_floating; }));
}

TEST(MarkFloating, WhatIsThereForAWhileOnlyHasComeAndIsHeldByNothingHidden) {
  EXPECT_EQ(NumFloatingOfThingSeenEvery(1.0), 4U);
  EXPECT_EQ(NumFloatingOfThingSeenEvery(2.0), 4U);
  // What sways may be elsewhere for ten seconds.
  EXPECT_EQ(NumFloatingOfThingSeenEvery(0.3, 200), 0U);
  // Seen now and then all the time, it may be a twig of what is hidden.
  EXPECT_EQ(NumFloatingOfThingSeenEvery(10.0), 0U);
  EXPECT_EQ(NumFloatingOfThingSeenEvery(16.0), 0U);
}

TEST(MarkFloating, IsThatOfItsDefinition) {
  const RangeRadius place = BackgroundConfig().place;
  for (std::uint32_t seed = 0; seed < 8; ++seed) {
    RecordingMaker maker(seed);
    testing::Random& random = maker.random;
    const bool is_timed = seed % 2 == 1;
    std::vector<Eigen::Vector3d> things_m;
    for (int k = 0; k < 14; ++k) things_m.push_back(random.InBox({5, -20, 5}, {45, 20, 30}));
    // Some have others beside them.
    for (int k = 0; k < 5; ++k) {
      things_m.push_back(things_m[random.Index(things_m.size())] + random.NormalVector(2.0));
    }
    for (int i = 0; i < 40; ++i) {
      maker.BeginFrame(i * testing::kPeriodS);
      TimeNs time_ns = maker.recording.frames.back().begin_ns;
      const auto add = [&](const Eigen::Vector3d& p) {
        if (is_timed) time_ns += 1'000'000;
        maker.AddAt(time_ns, p);
      };
      for (std::size_t k = 0; k < things_m.size(); ++k) {
        const bool is_there = (i / 10 + static_cast<int>(k)) % 4 != 0;
        if (is_there && random.Index(3) == 0) add(things_m[k] + random.NormalVector(0.05));
      }
      for (int k = 0; k < 6; ++k) add(random.InBox({5, -20, 5}, {45, 20, 30}));
    }
    const std::vector<char> floating = FloatingOf(maker.recording, place);
    EXPECT_EQ(floating, FloatingByDefinition(maker.recording, place)) << seed;
    EXPECT_GT(std::count(floating.begin(), floating.end(), 1), 20);
    EXPECT_GT(std::count(floating.begin(), floating.end(), 0), 20);
  }
}

}  // namespace
}  // namespace unlidar
