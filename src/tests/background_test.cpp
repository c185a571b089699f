#include "unlidar/robust/background.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <vector>

#include "range_grid_oracle.hpp"
#include "synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::IsNeighbour;
using testing::kBeginNs;
using testing::kPeriodS;
using testing::MiddleS;
using testing::RecordingMaker;

constexpr int kWall = 1;
constexpr int kTarget = 2;
constexpr int kOccluder = 3;

void AddWall(RecordingMaker* maker) {
  maker->AddBox({20.0, -3.0, -1.0}, {20.05, 3.0, 3.0}, 120, kWall);
}

// A recording of so many frames, filled by `fill(i)` once the frame has begun.
RecordingMaker MakeFrames(int num_frames, const std::function<void(int, RecordingMaker*)>& fill) {
  RecordingMaker maker(1);
  for (int i = 0; i < num_frames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    fill(i, &maker);
  }
  return maker;
}

// How many of the returns with this label no structure explains.
std::size_t NumUnexplained(const RecordingMaker& maker, const Background& background, int label) {
  return static_cast<std::size_t>(
      std::count_if(background.unexplained().begin(), background.unexplained().end(),
                    [&](std::uint32_t i) { return maker.labels[i] == label; }));
}

std::size_t NumOf(const RecordingMaker& maker, int label) {
  return static_cast<std::size_t>(std::count(maker.labels.begin(), maker.labels.end(), label));
}

TEST(Background, AWallHitAtRandomPlacesIsStructure) {
  const RecordingMaker maker = MakeFrames(120, [](int, RecordingMaker* m) { AddWall(m); });
  const Background background(maker.recording, BackgroundConfig());
  EXPECT_EQ(NumUnexplained(maker, background, kWall), 0U);
}

TEST(Background, ATargetThatMovesThroughIsUnexplainedAndTheWallBehindItIsNot) {
  for (const double speed_mps : {1.0, 5.0, 20.0}) {
    const RecordingMaker maker = MakeFrames(120, [&](int i, RecordingMaker* m) {
      AddWall(m);
      m->AddBlob({15.0, speed_mps * (MiddleS(i) - 6.0), 1.0}, 0.1, 5, kTarget);
    });
    const Background background(maker.recording, BackgroundConfig());
    EXPECT_EQ(NumUnexplained(maker, background, kTarget), NumOf(maker, kTarget)) << speed_mps;
    EXPECT_EQ(NumUnexplained(maker, background, kWall), 0U) << speed_mps;
  }
}

TEST(Background, AHoverOfAThirdOfTheRecordingIsUnexplained) {
  const RecordingMaker maker = MakeFrames(240, [](int i, RecordingMaker* m) {
    AddWall(m);
    const double time_s = MiddleS(i);  // comes, hovers from 8 s to 16 s, leaves
    const double moved_s = time_s < 8.0 ? time_s - 8.0 : std::max(0.0, time_s - 16.0);
    m->AddBlob({15.0, 3.0 * moved_s, 8.0}, 0.1, 5, kTarget);
  });
  const Background background(maker.recording, BackgroundConfig());
  EXPECT_EQ(NumUnexplained(maker, background, kTarget), NumOf(maker, kTarget));
}

TEST(Background, WhatStaysAllTheTimeIsStructureHoweverSmall) {
  const RecordingMaker maker = MakeFrames(240, [](int, RecordingMaker* m) {
    m->AddBlob({15.0, 0.0, 8.0}, 0.1, 5, kTarget);
  });
  const Background background(maker.recording, BackgroundConfig());
  EXPECT_EQ(NumUnexplained(maker, background, kTarget), 0U);
}

TEST(Background, WhatComesAndGoesIsStructureIfItIsThereOftenEnough) {
  // There for 2.5 s of every 5 s, or for half a second.
  for (const int present_frames : {25, 5}) {
    const RecordingMaker maker = MakeFrames(250, [&](int i, RecordingMaker* m) {
      if (i % 50 < present_frames) m->AddBlob({15.0, 0.0, 8.0}, 0.1, 5, kTarget);
    });
    const Background background(maker.recording, BackgroundConfig());
    EXPECT_EQ(NumUnexplained(maker, background, kTarget),
              present_frames == 25 ? 0U : NumOf(maker, kTarget));
  }
}

TEST(Background, APlaceThatIsHiddenAtOtherTimesIsNotFree) {
  // A thing at 20 m is seen for 2 s of 24 s. Without anything before it at the other times, it was
  // not there; behind a bus it may always have been.
  for (const bool is_hidden : {false, true}) {
    const RecordingMaker maker = MakeFrames(240, [&](int i, RecordingMaker* m) {
      if (i >= 100 && i < 120) {
        m->AddBlob({20.0, 0.0, 1.0}, 0.2, 5, kTarget);
      } else if (is_hidden) {
        m->AddBox({8.0, -3.0, -1.0}, {8.05, 3.0, 2.0}, 1000, kOccluder);
      }
    });
    const Background background(maker.recording, BackgroundConfig());
    EXPECT_EQ(NumUnexplained(maker, background, kTarget), is_hidden ? 0U : 100U);
  }
}

TEST(Background, WhatIsFartherHidesNothing) {
  const RecordingMaker maker = MakeFrames(240, [](int i, RecordingMaker* m) {
    m->AddBox({30.0, -9.0, -3.0}, {30.05, 9.0, 6.0}, 1000, kWall);
    if (i >= 100 && i < 120) m->AddBlob({20.0, 0.0, 1.0}, 0.2, 5, kTarget);
  });
  const Background background(maker.recording, BackgroundConfig());
  EXPECT_EQ(NumUnexplained(maker, background, kTarget), 100U);
}

TEST(Background, EveryReturnIsEitherStructureOrUnexplained) {
  RecordingMaker maker = MakeFrames(60, [](int i, RecordingMaker* m) {
    AddWall(m);
    m->AddBox({-30, -30, 0}, {30, 30, 30}, 20);
    m->AddBlob({15.0, 5.0 * MiddleS(i), 1.0}, 0.1, 5, kTarget);
  });
  const Background background(maker.recording, BackgroundConfig());
  const std::vector<std::uint32_t>& unexplained = background.unexplained();
  EXPECT_TRUE(std::is_sorted(unexplained.begin(), unexplained.end()));
  EXPECT_EQ(std::adjacent_find(unexplained.begin(), unexplained.end()), unexplained.end());
  std::vector<std::uint32_t> expected;
  for (std::uint32_t i = 0; i < maker.recording.points_m.size(); ++i) {
    if (!std::binary_search(unexplained.begin(), unexplained.end(), i)) expected.push_back(i);
  }
  EXPECT_GT(unexplained.size(), 100U);
  EXPECT_GT(expected.size(), 100U);
  EXPECT_EQ(background.structure(), expected);
}

TEST(Background, CountsEveryFrameInOneBinOfItsSensor) {
  RecordingMaker maker(1, 2);
  for (int i = 0; i < 57; ++i) {
    maker.BeginFrame(i * kPeriodS, i % 3 == 0 ? 1 : 0);
    AddWall(&maker);
  }
  const BackgroundConfig config;
  const Background background(maker.recording, config);
  ASSERT_EQ(background.frames_in_bin().size(), 2U);
  double frames = 0.0;
  for (std::size_t sensor = 0; sensor < 2; ++sensor) {
    ASSERT_EQ(background.frames_in_bin()[sensor].size(), background.num_bins());
    for (std::size_t b = 0; b < background.num_bins(); ++b) {
      double in_bin = 0.0;
      for (const FrameInfo& frame : maker.recording.frames) {
        if (frame.sensor == sensor && background.BinOf(frame.begin_ns) == b) in_bin += 1.0;
      }
      EXPECT_EQ(background.frames_in_bin()[sensor][b], in_bin);
      frames += in_bin;
    }
  }
  EXPECT_EQ(frames, 57.0);
  for (const TimeNs time_ns : maker.recording.times_ns) {
    EXPECT_EQ(background.BinOf(time_ns),
              static_cast<std::size_t>(testing::SecondsSinceBegin(time_ns) / config.bin_s));
  }
}

TEST(Background, RateOutsideIsThatOfBruteForce) {
  RecordingMaker maker = MakeFrames(100, [](int, RecordingMaker* m) {
    m->AddBox({5, -10, 0}, {25, 10, 10}, 60);
    AddWall(m);
  });
  const Recording& recording = maker.recording;
  const BackgroundConfig config;
  const Background background(recording, config);
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::Vector3f place_m = maker.random.InBox({0, -12, -2}, {30, 12, 12}).cast<float>();
    const double from_s = maker.random.Uniform(0.0, 9.0);
    const double to_s = from_s + maker.random.Uniform(0.0, 4.0);
    const auto bin_of = [&](double time_s) { return std::floor(time_s / config.bin_s); };
    const auto is_outside = [&](TimeNs time_ns) {
      const double bin = bin_of(testing::SecondsSinceBegin(time_ns));
      return bin < bin_of(from_s) || bin > bin_of(to_s);
    };
    double returns = 0.0;
    for (std::size_t i = 0; i < recording.points_m.size(); ++i) {
      if (is_outside(recording.times_ns[i]) &&
          IsNeighbour(config.place, place_m, recording.points_m[i])) {
        returns += 1.0;
      }
    }
    double frames = 0.0;
    for (const FrameInfo& frame : recording.frames) frames += is_outside(frame.begin_ns) ? 1 : 0;
    const double expected = returns / frames / testing::BlockVolumeM3(config.place, place_m);
    const double rate = background.RateOutside(place_m, kBeginNs + std::llround(from_s * 1e9),
                                               kBeginNs + std::llround(to_s * 1e9));
    EXPECT_NEAR(rate, expected, 1e-9 * expected) << place_m.transpose();
  }
}

TEST(Background, RateOutsideIsUnknownWhereHardlyAnyTimeIsLeft) {
  const RecordingMaker maker = MakeFrames(100, [](int, RecordingMaker* m) { AddWall(m); });
  const Background background(maker.recording, BackgroundConfig());
  const Eigen::Vector3f place_m(20.0F, 0.0F, 1.0F);
  const auto rate_outside = [&](double from_s, double to_s) {
    return background.RateOutside(place_m, kBeginNs + std::llround(from_s * 1e9),
                                  kBeginNs + std::llround(to_s * 1e9));
  };
  EXPECT_LT(rate_outside(0.0, 10.0), 0.0);
  EXPECT_LT(rate_outside(0.6, 10.0), 0.0);
  EXPECT_GT(rate_outside(2.1, 9.9), 0.0);
}

TEST(Background, APauseOfTheRecordingIsNoTimeInWhichAPlaceWasEmpty) {
  constexpr double kYear_s = 365.0 * 86400.0;
  for (const double pause_s : {2.5, 60.0, 40.0 * kYear_s}) {
    RecordingMaker maker(2);
    for (int i = 0; i < 120; ++i) {
      maker.BeginFrame(i * kPeriodS + (i < 60 ? 0.0 : pause_s));
      AddWall(&maker);
      maker.AddBlob({15.0, 3.0 * (MiddleS(i) - 6.0), 8.0}, 0.1, 5, kTarget);
    }
    const Background background(maker.recording, BackgroundConfig());
    EXPECT_LT(background.num_bins(), 40U) << pause_s;
    EXPECT_EQ(NumUnexplained(maker, background, kWall), 0U) << pause_s;
    EXPECT_EQ(NumUnexplained(maker, background, kTarget), NumOf(maker, kTarget)) << pause_s;
    double frames = 0.0;
    for (const double in_bin : background.frames_in_bin().front()) frames += in_bin;
    EXPECT_EQ(frames, 120.0);
  }
}

TEST(Background, APauseEndsAStay) {
  // There for the last four seconds before and the first four after: one stay only without a pause.
  for (const double pause_s : {0.0, 60.0}) {
    RecordingMaker maker(3);
    for (int i = 0; i < 120; ++i) {
      maker.BeginFrame(i * kPeriodS + (i < 60 ? 0.0 : pause_s));
      if (i >= 20 && i < 100) maker.AddBlob({15.0, 0.0, 8.0}, 0.1, 5, kTarget);
    }
    const Background background(maker.recording, BackgroundConfig());
    EXPECT_EQ(NumUnexplained(maker, background, kTarget), pause_s > 0.0 ? 0U : 400U);
  }
}

TEST(Background, AWallIsStructureAlsoInBurstsOfFramesBetweenLongPauses) {
  RecordingMaker maker(3);
  for (int i = 0; i < 120; ++i) {
    maker.BeginFrame(i * kPeriodS + 60.0 * (i / 4));
    AddWall(&maker);
  }
  const Background background(maker.recording, BackgroundConfig());
  EXPECT_EQ(NumUnexplained(maker, background, kWall), 0U);
}

TEST(Background, PlaceRateIsThatOfAPoissonProcessThatHitsSoManyOtherBins) {
  constexpr int kFrames = 300;
  const Eigen::Vector3d place_m(15.0, 3.0, 8.0);
  BackgroundConfig config;
  config.max_break_s = 0.0;  // every hit is a stay of its own
  double before = 0.0;
  for (const int spacing : {100, 30, 20, 10, 6, 4, 3}) {  // bins from hit to hit
    int num_hits = 0;
    const RecordingMaker maker = MakeFrames(kFrames, [&](int i, RecordingMaker* m) {
      if (i % (5 * spacing) != 2) return;
      m->Add(place_m, kTarget);
      ++num_hits;
    });
    const Background background(maker.recording, config);
    EXPECT_EQ(NumUnexplained(maker, background, kTarget), static_cast<std::size_t>(num_hits));
    const auto num_bins = static_cast<double>(background.num_bins());
    const double others = num_hits - 1.0;
    // Of the others one may be a passing target's.
    const double hits_per_frame =
        -std::log(1.0 - std::max(0.0, others - 1.0) / (num_bins - 1.0)) / (kFrames / num_bins);
    const double expected =
        hits_per_frame / testing::BlockVolumeM3(config.place, place_m.cast<float>());
    for (std::uint32_t i = 0; i < maker.recording.points_m.size(); ++i) {
      EXPECT_NEAR(background.PlaceRate(i), expected, 1e-3 * expected) << spacing;
    }
    if (others <= 1.0) {
      EXPECT_EQ(background.PlaceRate(0), 0.0);
    } else {
      EXPECT_GT(background.PlaceRate(0), before);
    }
    before = background.PlaceRate(0);
  }
}

TEST(Background, PlaceRateOfStructureAndOfWhatPassesIsZero) {
  const RecordingMaker maker = MakeFrames(120, [](int i, RecordingMaker* m) {
    AddWall(m);
    m->AddBlob({15.0, 5.0 * (MiddleS(i) - 6.0), 1.0}, 0.1, 5, kTarget);
  });
  const Background background(maker.recording, BackgroundConfig());
  for (std::uint32_t i = 0; i < maker.recording.points_m.size(); ++i) {
    EXPECT_EQ(background.PlaceRate(i), 0.0) << maker.labels[i];
  }
}

TEST(Background, OfNothingIsNothing) {
  const Background background(Recording{}, BackgroundConfig{});
  EXPECT_TRUE(background.unexplained().empty());
  EXPECT_EQ(background.num_bins(), 0U);
  const RecordingMaker empty_frames = MakeFrames(10, [](int, RecordingMaker*) {});
  EXPECT_TRUE(Background(empty_frames.recording, BackgroundConfig()).unexplained().empty());
}

}  // namespace
}  // namespace unlidar
