#include "scene/background.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <vector>

#include "tests/range_grid_oracle.hpp"
#include "tests/synthetic_recording.hpp"

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

// Which returns are structure, from the definition: over all bins of the time line, one by one, and
// all returns for each return.
std::vector<std::uint32_t> StructureByDefinition(const Recording& recording,
                                                 const BackgroundConfig& config) {
  const auto bin_ns = static_cast<TimeNs>(config.bin_s * 1e9);
  TimeNs begin_ns = recording.frames.front().begin_ns;
  for (const FrameInfo& f : recording.frames) begin_ns = std::min(begin_ns, f.begin_ns);
  const auto bin_of = [&](TimeNs time_ns) {
    return static_cast<std::size_t>((time_ns - begin_ns) / bin_ns);
  };
  std::vector<char> is_watched;
  for (const FrameInfo& f : recording.frames) {
    is_watched.resize(std::max(is_watched.size(), bin_of(f.end_ns) + 1), 0);
    for (std::size_t b = bin_of(f.begin_ns); b <= bin_of(f.end_ns); ++b) is_watched[b] = 1;
  }
  const std::size_t n = is_watched.size();
  const double all_watched =
      static_cast<double>(std::count(is_watched.begin(), is_watched.end(), 1));
  const auto max_break = static_cast<std::size_t>(config.max_break_s / config.bin_s);
  const auto is_one_place = [&](const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
    const double radius_m = testing::SteppedRadiusM(config.place, a);
    const auto voxel = [&](const Eigen::Vector3f& p) {
      return (p.cast<double>() / (radius_m * 2.0 / 3.0)).array().floor().eval();
    };
    return radius_m == testing::SteppedRadiusM(config.place, b) && (voxel(a) == voxel(b)).all();
  };
  const auto direction = [&](const Eigen::Vector3f& p) {
    const double degrees = 180.0 / M_PI;
    const double azimuth_deg = degrees * static_cast<double>(std::atan2(p.y(), p.x())) + 180.0;
    const double elevation_deg =
        degrees * static_cast<double>(std::atan2(p.z(), std::hypot(p.x(), p.y()))) + 90.0;
    return std::make_pair(std::floor(azimuth_deg / config.occluder_cell_deg),
                          std::floor(elevation_deg / config.occluder_cell_deg));
  };
  const std::vector<Eigen::Vector3f>& points_m = recording.points_m;
  std::vector<std::uint32_t> structure;
  for (std::uint32_t i = 0; i < points_m.size(); ++i) {
    // A place is judged where its first return was.
    std::size_t first = 0;
    while (!is_one_place(points_m[first], points_m[i])) ++first;
    const Eigen::Vector3f& place_m = points_m[first];
    std::vector<char> is_occupied(n, 0);
    std::vector<std::vector<double>> ranges_m(n);
    for (std::size_t k = 0; k < points_m.size(); ++k) {
      const std::size_t b = bin_of(recording.times_ns[k]);
      if (IsNeighbour(config.place, place_m, points_m[k])) is_occupied[b] = 1;
      if (direction(place_m) == direction(points_m[k])) {
        ranges_m[b].push_back(0.05 * std::floor(static_cast<double>(points_m[k].norm()) / 0.05));
      }
    }
    std::vector<char> is_behind(n, 0);
    for (std::size_t b = 0; b < n; ++b) {
      if (ranges_m[b].empty()) continue;
      std::sort(ranges_m[b].begin(), ranges_m[b].end());
      is_behind[b] = ranges_m[b][ranges_m[b].size() / 2] <
                     static_cast<double>(place_m.norm()) - config.occluder_margin_m;
    }
    const std::size_t here = bin_of(recording.times_ns[i]);
    std::size_t from = here;
    for (std::size_t b = here; b-- > 0 && from - b <= max_break + 1;)
      from = is_occupied[b] ? b : from;
    std::size_t to = here;
    for (std::size_t b = here; ++b < n && b - to <= max_break + 1;) to = is_occupied[b] ? b : to;
    double exposed = 0.0;
    double occupied = 0.0;
    for (std::size_t b = 0; b < n; ++b) {
      if (!is_watched[b] || (b >= from && b <= to)) continue;
      if (is_occupied[b] || !is_behind[b] || is_behind[here]) exposed += 1.0;
      if (is_occupied[b]) occupied += 1.0;
    }
    if (exposed < config.min_exposure * all_watched || occupied > config.max_occupancy * exposed) {
      structure.push_back(i);
    }
  }
  return structure;
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

TEST(Background, TellsStructureByItsDefinition) {
  for (std::uint32_t seed = 0; seed < 6; ++seed) {
    RecordingMaker maker(seed, 2);
    testing::Random& random = maker.random;
    // Things that are there for random stretches of time, some behind others, and strays.
    std::vector<Eigen::Vector3d> things_m;
    std::vector<double> shares;
    for (int k = 0; k < 12; ++k) {
      things_m.push_back(random.InBox({6.0, -3.0, -1.0}, {24.0, 3.0, 3.0}));
      shares.push_back(random.Uniform(0.0, 1.0));
    }
    double time_s = 0.0;
    for (int i = 0; i < 50; ++i) {
      maker.BeginFrame(time_s, random.Index(2));
      time_s += seed < 2 || i % 7 != 0 ? kPeriodS : random.Uniform(0.1, 6.0);
      const bool has_bus = i % 16 < 6;
      if (has_bus) maker.AddBox({5.0, -2.0, -1.0}, {5.1, 1.0, 1.5}, 30, kOccluder);
      for (std::size_t k = 0; k < things_m.size(); ++k) {
        const bool is_there = std::fmod(i / 11.0 + shares[k] * 3.0, 1.0) < shares[k];
        if (is_there) maker.AddBlob(things_m[k], 0.15, 1, kWall);
      }
      maker.AddBox({2, -10, -2}, {30, 10, 10}, 4);
    }
    const BackgroundConfig config;
    const std::vector<std::uint32_t> expected = StructureByDefinition(maker.recording, config);
    const Background background(maker.recording, config);
    EXPECT_EQ(background.structure(), expected) << seed;
    EXPECT_GT(background.structure().size(), 100U);
    EXPECT_GT(background.unexplained().size(), 100U);
  }
}

TEST(Background, PausesTakeNoBins) {
  for (const double pause_s : {2.0, 3600.0, 1e7}) {
    RecordingMaker maker(7);
    for (int i = 0; i < 20; ++i) {
      maker.BeginFrame(i * pause_s);
      maker.AddBox({5, -10, 0}, {25, 10, 10}, 20);
    }
    const Background background(maker.recording, BackgroundConfig());
    EXPECT_EQ(background.num_bins(), 20U) << pause_s;
    for (std::uint32_t bin = 0; bin < 20; ++bin) {
      const BinRange around = background.BinsAround(bin, 2);
      EXPECT_EQ(around.first, bin);
      EXPECT_EQ(around.last, bin + 1);
    }
  }
}

TEST(Background, BinsAroundABinAreThoseThatAreNearInTime) {
  const RecordingMaker maker = MakeFrames(100, [](int, RecordingMaker*) {});
  const Background background(maker.recording, BackgroundConfig());
  const std::uint32_t n = background.num_bins();
  for (std::uint32_t bin = 0; bin < n; ++bin) {
    const BinRange around = background.BinsAround(bin, 2);
    EXPECT_EQ(around.first, bin < 2 ? 0 : bin - 2);
    EXPECT_EQ(around.last, std::min(bin + 3, n));
  }
}

TEST(Background, CountsEveryFrameInOneBinOfItsSensor) {
  RecordingMaker maker(1, 2);
  for (int i = 0; i < 57; ++i) {
    maker.BeginFrame(i * kPeriodS, i % 3 == 0 ? 1 : 0);
    AddWall(&maker);
  }
  const BackgroundConfig config;
  const Background background(maker.recording, config);
  std::uint32_t frames = 0;
  for (std::size_t sensor = 0; sensor < 2; ++sensor) {
    for (std::uint32_t b = 0; b < background.num_bins(); ++b) {
      std::uint32_t in_bin = 0;
      for (const FrameInfo& frame : maker.recording.frames) {
        if (frame.sensor == sensor && background.BinOf(frame.begin_ns) == b) ++in_bin;
      }
      EXPECT_EQ(background.NumFrames(sensor, {b, b + 1}), in_bin);
      frames += in_bin;
    }
    EXPECT_EQ(background.NumFrames(sensor, {0, background.num_bins()}), sensor == 0 ? 38U : 19U);
  }
  EXPECT_EQ(frames, 57U);
  for (const TimeNs time_ns : maker.recording.times_ns) {
    EXPECT_EQ(background.BinOf(time_ns),
              static_cast<std::uint32_t>(testing::SecondsSinceBegin(time_ns) / config.bin_s));
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
    const double expected =
        std::max(returns, 0.5) / frames / testing::BlockVolumeM3(config.place, place_m);
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
    EXPECT_EQ(background.NumFrames(0, {0, background.num_bins()}), 120U);
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
