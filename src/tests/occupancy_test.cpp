#include "scene/occupancy.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "tests/draws.hpp"
#include "tests/learned_occupancy.hpp"
#include "tests/range_grid_oracle.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::IsNeighbour;
using testing::JudgeOne;
using testing::kPeriodS;
using testing::LearnedOccupancy;
using testing::MiddleS;
using testing::Random;
using testing::RecordingMaker;

class OccupancyTest : public ::testing::Test {
 protected:
  // A bin of five frames in which a place is hit or not.
  void Bin(std::int64_t bin, bool is_hit, const Eigen::Vector3f& place_m = {10, 5, 3}) {
    for (int frame = 0; frame < 4; ++frame)
      occupancy_.AddFrame(std::vector<Eigen::Vector3f>(), bin);
    std::vector<Eigen::Vector3f> points_m;
    if (is_hit) points_m.push_back(place_m);
    occupancy_.AddFrame(points_m, bin);
  }

  bool IsStructure(std::int64_t bin, const Eigen::Vector3f& place_m = {10, 5, 3}) {
    return JudgeOne(&occupancy_, place_m, bin).is_structure;
  }

  std::vector<Eigen::Vector3f> Structure() const {
    std::vector<Eigen::Vector3f> points_m;
    occupancy_.GetStructure(&points_m);
    return points_m;
  }

  std::vector<Eigen::Vector3f> Supporters() const {
    std::vector<Eigen::Vector3f> points_m;
    std::vector<char> are_lasting;
    occupancy_.GetSupporters(&points_m, &are_lasting);
    return points_m;
  }

  Occupancy occupancy_{BackgroundConfig()};
};

const Eigen::Vector3d kCrown_m(16.0, 0.0, 1.0);

// A sky of strays, equally many along each metre of a ray, so many in a cubic metre and frame at
// the crown, and what a frame shows besides.
template <class Fill>
Occupancy AmongStraysAnd(double per_m3, bool knows_strays, const Fill& fill) {
  Occupancy occupancy(BackgroundConfig(), knows_strays);
  Random random(5);
  const auto count = static_cast<int>(per_m3 * 18.0 * 12.0 * 12.0);
  for (std::int64_t bin = 0; bin < 40; ++bin) {
    for (int frame = 0; frame < 5; ++frame) {
      std::vector<Eigen::Vector3f> points_m;
      for (int i = 0; i < count; ++i) {
        const Eigen::Vector3d ray = random.InBox({4, -0.375, -0.375}, {22, 0.375, 0.375});
        const Eigen::Vector3d point_m(ray.x(), ray.x() * ray.y(), ray.x() * ray.z());
        points_m.push_back(point_m.cast<float>());
      }
      fill(bin, &random, &points_m);
      occupancy.AddFrame(points_m, bin);
    }
  }
  return occupancy;
}

Occupancy AmongStrays(double per_m3, bool knows_strays, int num_of_crown = 0) {
  const auto fill = [&](std::int64_t, Random* random, std::vector<Eigen::Vector3f>* points_m) {
    for (int i = 0; i < num_of_crown; ++i) {
      points_m->push_back((kCrown_m + random->InBox({-1, -1, -1}, {1, 1, 1})).cast<float>());
    }
  };
  return AmongStraysAnd(per_m3, knows_strays, fill);
}

TEST(Occupancy, InASquallThePresentRateOfStraysIsThatOfItsTime) {
  constexpr double kRate = 0.02;
  const auto squall = [](std::int64_t bin, Random* random, std::vector<Eigen::Vector3f>* points_m) {
    const std::size_t num_more = bin < 38 ? 0 : 4 * points_m->size();
    for (std::size_t i = 0; i < num_more; ++i) {
      const Eigen::Vector3d ray = random->InBox({4, -0.375, -0.375}, {22, 0.375, 0.375});
      points_m->emplace_back(
          Eigen::Vector3d(ray.x(), ray.x() * ray.y(), ray.x() * ray.z()).cast<float>());
    }
  };
  const Occupancy occupancy = AmongStraysAnd(kRate, true, squall);
  double rate = 0.0;
  double before = 0.0;
  double present = 0.0;
  for (int y = -3; y <= 3; ++y) {
    const Eigen::Vector3f place_m(16.0F, static_cast<float>(y), 1.0F);
    rate += occupancy.UsualStrayRate(place_m) / 7.0;
    before += occupancy.StrayRateIn(place_m, 30).present / 7.0;
    present += occupancy.StrayRateIn(place_m, 39).present / 7.0;
  }
  EXPECT_LT(before, 1.5 * rate);
  EXPECT_GT(present, 3.0 * rate);
  EXPECT_LT(present, 6.0 * rate);
}

TEST(Occupancy, TheRateOfStraysIsTheirDensityBeforeAPlaceAndBeforeAWallNone) {
  for (const double per_m3 : {0.02, 0.05, 0.1}) {
    const Occupancy occupancy = AmongStrays(per_m3, true);
    double sum = 0.0;
    for (int y = -3; y <= 3; ++y) {
      sum += occupancy.UsualStrayRate({16.0F, static_cast<float>(y), 1.0F}) / 7.0;
    }
    EXPECT_GT(sum, 0.9 * per_m3);  // the lower of two nearer ones, where they are denser
    EXPECT_LT(sum, 2.6 * per_m3);
  }
  Occupancy clear{BackgroundConfig()};
  for (std::int64_t bin = 0; bin < 40; ++bin)
    clear.AddFrame(std::vector{Eigen::Vector3f(16, 0, 1)}, bin);
  EXPECT_EQ(clear.UsualStrayRate({16, 0, 1}), 0.0);
}

TEST(Occupancy, AmongStraysAPlaceThatIsOftenHitIsClutterAndNoStructure) {
  const auto is_structure = [](bool knows_strays) {
    Occupancy occupancy = AmongStrays(0.1, knows_strays);
    int count = 0;
    for (int y = -3; y <= 3; ++y) {
      const Eigen::Vector3f place_m(16.0F, static_cast<float>(y), 1.0F);
      occupancy.AddFrame(std::vector{place_m}, 39);
      const Occupancy::Verdict verdict = JudgeOne(&occupancy, place_m, 39);
      count += verdict.is_structure ? 1 : 0;
    }
    return count;
  };
  EXPECT_GE(is_structure(false), 4);
  EXPECT_LE(is_structure(true), 1);
}

// Both are hit in every bin.
TEST(Occupancy, DenseStraysExplainEachOtherAndNoCrown) {
  for (const double per_m3 : {0.4, 2.0}) {
    const auto stray_rate = [&](int num_of_crown) {
      Occupancy occupancy = AmongStrays(per_m3, true, num_of_crown);
      const Occupancy::Verdict verdict = JudgeOne(&occupancy, kCrown_m.cast<float>(), 39);
      EXPECT_TRUE(verdict.is_structure) << per_m3;
      return verdict.stray_rate;
    };
    EXPECT_GT(stray_rate(0), 0.0) << per_m3;
    EXPECT_EQ(stray_rate(600), 0.0) << per_m3;
    EXPECT_EQ(stray_rate(static_cast<int>(40 * per_m3)), 0.0) << per_m3;
  }
}

// Each is hit in every bin, and the nearer, the more often in a cubic metre.
TEST(Occupancy, SurfacesOneBehindAnotherAreNoStrays) {
  const Eigen::Vector3d place_m(10.0, 0.0, 1.0);
  const auto fill = [&](std::int64_t, Random* random, std::vector<Eigen::Vector3f>* points_m) {
    for (const double share : {0.5, 0.75, 1.0}) {
      for (int i = 0; i < 400; ++i) {
        const Eigen::Vector3d part_m = random->InBox({-0.05, -2.0, -2.0}, {0.05, 2.0, 2.0});
        points_m->push_back((share * (place_m + part_m)).cast<float>());
      }
    }
  };
  Occupancy occupancy = AmongStraysAnd(0.0, true, fill);
  const Occupancy::Verdict verdict = JudgeOne(&occupancy, place_m.cast<float>(), 39);
  EXPECT_TRUE(verdict.is_structure);
  EXPECT_EQ(verdict.stray_rate, 0.0);
}

TEST(Occupancy, ATargetThatHoversAmongDenseStraysLeavesItsPlaceToThem) {
  constexpr std::int64_t kCameBin = 15;
  const auto fill = [&](std::int64_t bin, Random* random, std::vector<Eigen::Vector3f>* points_m) {
    for (int i = 0; bin >= kCameBin && i < 10; ++i) {
      const Eigen::Vector3d part_m = random->InBox({-0.3, -0.3, -0.3}, {0.3, 0.3, 0.3});
      points_m->push_back((kCrown_m + part_m).cast<float>());
    }
  };
  Occupancy occupancy = AmongStraysAnd(0.4, true, fill);
  EXPECT_GT(JudgeOne(&occupancy, kCrown_m.cast<float>(), 39).stray_rate, 0.0);
}

TEST_F(OccupancyTest, WhatIsHitAtMostTimesIsStructureAndWhatComesAnewIsNot) {
  for (std::int64_t bin = 0; bin < 50; ++bin) {
    Bin(bin, bin % 6 != 0);
    Bin(bin, bin >= 48, {0, 20, 8});
  }
  EXPECT_TRUE(IsStructure(49));
  EXPECT_FALSE(IsStructure(49, {0, 20, 8}));
}

TEST_F(OccupancyTest, OfWhatWasThereFromTheBeginTooLittleIsKnown) {
  for (std::int64_t bin = 0; bin < 200; ++bin) {
    Bin(bin, true);
    EXPECT_TRUE(IsStructure(bin)) << bin;
  }
}

// But for a target that is known to have been there for as long.
TEST_F(OccupancyTest, WhatCameWithATargetIsNoStructure) {
  constexpr std::int64_t kCame = 3;
  const auto is_target = [](const Eigen::Vector3f&, std::int64_t bin) { return bin >= kCame; };
  const Eigen::Vector3f here_m(10, 5, 3);
  const Eigen::Vector3f tree_m(0, 20, 8);
  const Eigen::Vector3f pole_m(-9, 9, 2);
  for (std::int64_t bin = 0; bin < 100; ++bin) {
    Bin(bin, bin >= kCame, here_m);
    Bin(bin, true, tree_m);
    Bin(bin, bin % 5 != 0, pole_m);
    const auto is_structure = [&](const Eigen::Vector3f& place_m) {
      return JudgeOne(&occupancy_, place_m, bin, is_target).is_structure;
    };
    if (bin >= kCame && bin < 60) {
      EXPECT_FALSE(is_structure(here_m)) << bin;
      for (const Eigen::Vector3f& place_m : Structure()) EXPECT_NE(place_m, here_m) << bin;
    }
    EXPECT_TRUE(is_structure(tree_m)) << bin;
    if (bin > 20) {
      EXPECT_TRUE(is_structure(pole_m) || bin % 5 == 0) << bin;
    }
  }
}

TEST_F(OccupancyTest, TellsSinceWhenAPlaceIsHit) {
  for (std::int64_t bin = 0; bin < 320; ++bin) {
    Bin(bin, bin < 4 || (bin >= 40 && bin % 2 == 0));
    const Occupancy::Verdict verdict = JudgeOne(&occupancy_, {10, 5, 3}, bin);
    if (bin >= 40 && bin < 290) {
      EXPECT_EQ(verdict.dwell_begin_bin, 40) << bin;
    } else if (bin >= 300) {  // it may have begun before the window
      EXPECT_FALSE(verdict.dwell_begin_bin) << bin;
    }
  }
}

// The rays hit a pole here and there.
TEST_F(OccupancyTest, WhatIsHitHereAndThereRemainsStructure) {
  const auto at = [](std::int64_t bin) {
    return Eigen::Vector3f(10.0F, 5.0F, 3.0F + 0.45F * static_cast<float>(bin / 2 % 3));
  };
  for (std::int64_t bin = 0; bin < 1200; ++bin) {
    Bin(bin, bin % 2 == 0, at(bin));
    if (bin > 100 && bin % 100 == 0) {
      EXPECT_TRUE(IsStructure(bin)) << bin;
    }
  }
}

// By chance its dwells last for longer than the window, or break.
TEST_F(OccupancyTest, WhatIsHitByChanceRemainsStructure) {
  for (const double share : {0.5, 0.6, 0.7, 0.8, 0.9, 0.95}) {
    occupancy_ = Occupancy(BackgroundConfig());
    Random random(1);
    int hits = 0;
    int taken_for_new = 0;
    for (std::int64_t bin = 0; bin < 4000; ++bin) {
      const bool is_hit = random.Uniform(0.0, 1.0) < share;
      Bin(bin, is_hit);
      if (!is_hit || bin < 100) continue;
      ++hits;
      taken_for_new += IsStructure(bin) ? 0 : 1;
    }
    EXPECT_LT(taken_for_new, 0.01 * hits) << share;
  }
}

TEST_F(OccupancyTest, WhatIsHitSeldomButAgainAndAgainSupports) {
  for (std::int64_t bin = 0; bin < 60; ++bin) {
    Bin(bin, bin % 5 == 0);
    Bin(bin, bin == 55, {0, 20, 8});
    if (bin % 5 == 0) IsStructure(bin);
  }
  EXPECT_FALSE(IsStructure(55));
  EXPECT_FALSE(IsStructure(55, {0, 20, 8}));
  EXPECT_TRUE(Structure().empty());
  EXPECT_EQ(Supporters().size(), 1U);
}

// In the first seconds nobody knows how often a place is hit, but a trail is left behind.
TEST_F(OccupancyTest, WhatIsHitUntilNowSupportsAtFirstAndWhatWasLeftDoesNot) {
  for (std::int64_t bin = 0; bin < 9; ++bin) {
    Bin(bin, bin == 2 || bin == 6);
    Bin(bin, bin == 3 || bin == 4, {0, 20, 8});
  }
  EXPECT_FALSE(IsStructure(6));
  EXPECT_FALSE(IsStructure(4, {0, 20, 8}));
  const std::vector<Eigen::Vector3f> supporters_m = Supporters();
  ASSERT_EQ(supporters_m.size(), 1U);
  EXPECT_EQ(supporters_m[0], Eigen::Vector3f(10, 5, 3));
  for (std::int64_t bin = 9; bin < 20; ++bin) Bin(bin, false);
  EXPECT_TRUE(Supporters().empty());
}

// Flakes about a place that none has hit yet say what is to be expected there; a wall beside it
// does not.
TEST_F(OccupancyTest, ChanceSparesPlacesButNotTheirRate) {
  Random random(1);
  const Eigen::Vector3f place_m(10, 5, 3);
  const Eigen::Vector3f by_wall_m(-10, 5, 3);
  for (std::int64_t bin = 0; bin < 60; ++bin) {
    Bin(bin, false);
    std::vector<Eigen::Vector3f> points_m;
    for (int k = 0; k < 50; ++k) {
      const Eigen::Vector3f flake_m =
          place_m + Eigen::Vector3f(static_cast<float>(random.Uniform(-3.0, 3.0)),
                                    static_cast<float>(random.Uniform(-3.0, 3.0)),
                                    static_cast<float>(random.Uniform(-3.0, 3.0)));
      if ((flake_m - place_m).norm() > 1.2F) points_m.push_back(flake_m);
    }
    for (int k = -20; k < 20; ++k) {
      points_m.emplace_back(by_wall_m + Eigen::Vector3f(-1.8F, 0.1F * static_cast<float>(k), 0.0F));
    }
    occupancy_.AddFrame(points_m, bin);
  }
  const double per_frame_m3 = 50.0 / 6.0 / 216.0;
  EXPECT_GT(occupancy_.RateAround(place_m, 59), 0.3 * per_frame_m3);
  EXPECT_LT(occupancy_.RateAround(place_m, 59), 3.0 * per_frame_m3);
  EXPECT_EQ(occupancy_.RateAround(by_wall_m, 59), 0.0);
  EXPECT_EQ(occupancy_.RateAround({0, -20, 8}, 59), 0.0);
}

// If the place was known to be empty for 15 % of the window before.
TEST_F(OccupancyTest, ADwellThatOutlastsTheWindowDoesNotBecomeStructure) {
  for (std::int64_t bin = 0; bin < 40; ++bin) Bin(bin, false);
  for (std::int64_t bin = 40; bin < 1000; ++bin) {
    Bin(bin, true);
    EXPECT_FALSE(IsStructure(bin)) << bin;
  }
}

TEST_F(OccupancyTest, WhatWasThereAllDayIsStructureAfterItWasHidden) {
  for (std::int64_t bin = 0; bin < 600; ++bin) Bin(bin, bin % 5 != 0);
  EXPECT_TRUE(IsStructure(599));
  for (std::int64_t bin = 600; bin < 640; ++bin) Bin(bin, false);
  for (std::int64_t bin = 640; bin < 644; ++bin) {
    Bin(bin, true);
    EXPECT_TRUE(IsStructure(bin)) << bin;
  }
}

TEST_F(OccupancyTest, SweepingErasesPlacesThatWereNotHitInTheWindow) {
  const Eigen::Vector3f once_m(0, 20, 8);
  Bin(0, true, once_m);
  for (std::int64_t bin = 0; bin < 300; ++bin) Bin(bin, bin % 3 != 0);
  EXPECT_FALSE(IsStructure(299, once_m));  // known to be empty
  EXPECT_TRUE(IsStructure(299));
  occupancy_.Sweep();
  EXPECT_TRUE(IsStructure(299, once_m));  // nothing is known
  EXPECT_TRUE(IsStructure(299));
  EXPECT_EQ(Structure().size(), 1U);
}

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

// Things that are there for random stretches of time, a bus that hides some of them, strays, and in
// most of these recordings pauses.
RecordingMaker DrawnRecording(std::uint32_t seed) {
  RecordingMaker maker(seed, 2);
  Random& random = maker.random;
  std::vector<Eigen::Vector3d> things_m;
  std::vector<double> shares;
  for (int k = 0; k < 12; ++k) {
    things_m.push_back(random.InBox({6.0, -3.0, -1.0}, {24.0, 3.0, 3.0}));
    shares.push_back(random.Uniform(0.0, 1.0));
  }
  double time_s = 0.0;
  for (int i = 0; i < 150; ++i) {
    maker.BeginFrame(time_s, random.Index(2));
    time_s += seed < 2 || i % 17 != 0 ? kPeriodS : random.Uniform(0.1, 6.0);
    if (i % 48 < 18) maker.AddBox({5.0, -2.0, -1.0}, {5.1, 1.0, 1.5}, 30, kOccluder);
    for (std::size_t k = 0; k < things_m.size(); ++k) {
      const bool is_there = std::fmod(i / 33.0 + shares[k] * 3.0, 1.0) < shares[k];
      if (is_there && random.Index(2) == 0) maker.AddBlob(things_m[k], 0.15, 1, kWall);
    }
    maker.AddBox({2, -10, -2}, {30, 10, 10}, 3);
  }
  return maker;
}

// Which returns are structure, from the definition: over all half seconds of the time line, but for
// the third and later ones of a pause, one by one, and all returns for each return.
std::vector<bool> StructureByDefinition(const Recording& recording,
                                        const BackgroundConfig& config) {
  const TimeNs begin_ns = recording.frames.front().begin_ns;
  const auto half_second_of = [&](TimeNs time_ns) {
    return static_cast<std::size_t>((time_ns - begin_ns) / NsOf(kBinS));
  };
  std::vector<char> has_frames(half_second_of(recording.frames.back().middle_ns()) + 1, 0);
  for (const FrameInfo& frame : recording.frames) has_frames[half_second_of(frame.middle_ns())] = 1;
  std::vector<char> is_observed;
  std::vector<std::size_t> bins(has_frames.size(), 0);
  int pause = 0;
  for (std::size_t k = 0; k < has_frames.size(); ++k) {
    pause = has_frames[k] ? 0 : pause + 1;
    if (pause <= 2) is_observed.push_back(has_frames[k]);
    bins[k] = is_observed.size() - 1;
  }
  const auto bin_of = [&](TimeNs time_ns) { return bins[half_second_of(time_ns)]; };
  const std::size_t n = is_observed.size();
  const auto num_observed =
      static_cast<double>(std::count(is_observed.begin(), is_observed.end(), 1));
  const auto max_break = static_cast<std::size_t>(config.max_dwell_gap_s / kBinS);
  const auto cell_of = [](const Eigen::Vector3f& p) {
    const double degrees = 180.0 / M_PI;
    const double azimuth_deg = degrees * static_cast<double>(std::atan2(p.y(), p.x())) + 180.0;
    const double elevation_deg =
        degrees * static_cast<double>(std::atan2(p.z(), std::hypot(p.x(), p.y()))) + 90.0;
    return std::make_pair(std::floor(azimuth_deg / 2.0), std::floor(elevation_deg / 2.0));
  };
  std::vector<bool> are_structure;
  for (std::size_t i = 0; i < recording.points_m.size(); ++i) {
    std::vector<char> is_occupied(n, 0);
    for (std::size_t k = 0; k < recording.points_m.size(); ++k) {
      if (IsNeighbour(config.place, recording.points_m[i], recording.points_m[k])) {
        is_occupied[bin_of(recording.times_ns[k])] = 1;
      }
    }
    std::size_t from = bin_of(recording.times_ns[i]);
    std::size_t to = from;
    for (std::size_t b = from; b-- > 0 && from - b <= max_break + 1;) {
      from = is_occupied[b] ? b : from;
    }
    for (std::size_t b = to; ++b < n && b - to <= max_break + 1;) to = is_occupied[b] ? b : to;
    // The direction of a place is that of its first return in the last bin with any.
    const double edge_m = 2.0 / 3.0 * testing::SteppedRadiusM(config.place, recording.points_m[i]);
    const auto voxel_of = [&](const Eigen::Vector3f& p) {
      return (p.cast<double>() / edge_m).array().floor().eval();
    };
    std::size_t place = i;
    for (std::size_t k = 0; k < recording.points_m.size(); ++k) {
      if ((voxel_of(recording.points_m[k]) != voxel_of(recording.points_m[i])).any()) continue;
      const std::size_t later = bin_of(recording.times_ns[k]);
      const std::size_t last = bin_of(recording.times_ns[place]);
      if (later > last || (later == last && k < place)) place = k;
    }
    const Eigen::Vector3f& place_m = recording.points_m[place];
    std::vector<std::vector<double>> ranges_m(n);
    for (std::size_t k = 0; k < recording.points_m.size(); ++k) {
      if (cell_of(recording.points_m[k]) != cell_of(place_m)) continue;
      const auto range_m = static_cast<double>(recording.points_m[k].norm());
      ranges_m[bin_of(recording.times_ns[k])].push_back(0.05 * std::floor(range_m / 0.05));
    }
    std::vector<char> is_hidden(n, 0);
    for (std::size_t b = 0; b + 1 < n; ++b) {
      if (ranges_m[b].empty()) continue;
      std::sort(ranges_m[b].begin(), ranges_m[b].end());
      is_hidden[b] =
          ranges_m[b][ranges_m[b].size() / 2] < static_cast<double>(place_m.norm()) - 2.0;
    }
    if (n > 1) is_hidden[n - 1] = is_hidden[n - 2];  // of the bin in progress too little is known
    bool is_through_gaps = false;
    for (std::size_t b = from; b <= to; ++b) {
      is_through_gaps = is_through_gaps || (is_hidden[b] && is_occupied[b]);
    }
    double exposed = 0.0;
    double occupied = 0.0;
    for (std::size_t b = 0; b < n; ++b) {
      if (!is_observed[b] || (b >= from && b <= to)) continue;
      if (is_occupied[b] || !is_hidden[b] || is_through_gaps) exposed += 1.0;
      if (is_occupied[b]) occupied += 1.0;
    }
    are_structure.push_back(exposed < config.min_exposure * std::min(num_observed, 128.0) ||
                            occupied > config.max_occupancy * exposed);
  }
  return are_structure;
}

// Number of the returns with this label that no structure explains.
std::size_t NumUnexplained(const RecordingMaker& maker, int label) {
  LearnedOccupancy learned(maker.recording);
  std::size_t count = 0;
  for (std::size_t i = 0; i < maker.labels.size(); ++i) {
    if (maker.labels[i] == label && !learned.Judge(maker.recording, i).is_structure) ++count;
  }
  return count;
}

std::size_t NumOf(const RecordingMaker& maker, int label) {
  return static_cast<std::size_t>(std::count(maker.labels.begin(), maker.labels.end(), label));
}

TEST(OccupancyOfRecording, AWallHitAtRandomPlacesIsStructure) {
  const RecordingMaker maker = MakeFrames(120, [](int, RecordingMaker* m) { AddWall(m); });
  EXPECT_EQ(NumUnexplained(maker, kWall), 0U);
}

TEST(OccupancyOfRecording, TheStructureOfAllPlacesIsKnownBeforeReturnsAreJudged) {
  const RecordingMaker maker = MakeFrames(120, [](int i, RecordingMaker* m) {
    AddWall(m);
    m->AddBlob({15.0, 3.0 * (MiddleS(i) - 6.0), 8.0}, 0.1, 5, kTarget);
  });
  std::vector<Eigen::Vector3f> structure_m;
  LearnedOccupancy(maker.recording).occupancy().GetStructure(&structure_m);
  EXPECT_GT(structure_m.size(), 50U);
  for (const Eigen::Vector3f& point_m : structure_m) EXPECT_GT(point_m.x(), 19.0F);
}

TEST(OccupancyOfRecording, ATargetThatMovesThroughIsUnexplainedAndTheWallBehindItIsNot) {
  for (const double speed_mps : {1.0, 5.0, 20.0}) {
    const RecordingMaker maker = MakeFrames(120, [&](int i, RecordingMaker* m) {
      AddWall(m);
      m->AddBlob({15.0, speed_mps * (MiddleS(i) - 6.0), 1.0}, 0.1, 5, kTarget);
    });
    EXPECT_EQ(NumUnexplained(maker, kTarget), NumOf(maker, kTarget)) << speed_mps;
    EXPECT_EQ(NumUnexplained(maker, kWall), 0U) << speed_mps;
  }
}

TEST(OccupancyOfRecording, AHoverOfAThirdOfTheRecordingIsUnexplained) {
  const RecordingMaker maker = MakeFrames(240, [](int i, RecordingMaker* m) {
    AddWall(m);
    const double time_s = MiddleS(i);  // comes, hovers from 8 s to 16 s, leaves
    const double moved_s = time_s < 8.0 ? time_s - 8.0 : std::max(0.0, time_s - 16.0);
    m->AddBlob({15.0, 3.0 * moved_s, 8.0}, 0.1, 5, kTarget);
  });
  EXPECT_EQ(NumUnexplained(maker, kTarget), NumOf(maker, kTarget));
}

TEST(OccupancyOfRecording, WhatStaysAllTheTimeIsStructureHoweverSmall) {
  const RecordingMaker maker = MakeFrames(240, [](int, RecordingMaker* m) {
    m->AddBlob({15.0, 0.0, 8.0}, 0.1, 5, kTarget);
  });
  EXPECT_EQ(NumUnexplained(maker, kTarget), 0U);
}

TEST(OccupancyOfRecording, WhatComesAndGoesIsStructureIfItIsThereOftenEnough) {
  // There for 2.5 s of every 5 s, or for half a second.
  for (const int present_frames : {25, 5}) {
    const RecordingMaker maker = MakeFrames(250, [&](int i, RecordingMaker* m) {
      if (i % 50 < present_frames) m->AddBlob({15.0, 0.0, 8.0}, 0.1, 5, kTarget);
    });
    EXPECT_EQ(NumUnexplained(maker, kTarget), present_frames == 25 ? 0U : NumOf(maker, kTarget));
  }
}

TEST(OccupancyOfRecording, TellsStructureByItsDefinition) {
  for (std::uint32_t seed = 0; seed < testing::Draws(6U); ++seed) {
    const RecordingMaker maker = DrawnRecording(seed);
    LearnedOccupancy learned(maker.recording);
    std::vector<bool> are_structure;
    for (const Occupancy::Verdict& verdict : learned.Verdicts(maker.recording)) {
      are_structure.push_back(verdict.is_structure);
    }
    EXPECT_EQ(are_structure, StructureByDefinition(maker.recording, BackgroundConfig())) << seed;
    EXPECT_GT(std::count(are_structure.begin(), are_structure.end(), true), 100);
    EXPECT_GT(std::count(are_structure.begin(), are_structure.end(), false), 100);
  }
}

TEST(OccupancyOfRecording, APlaceThatIsHiddenAtOtherTimesIsNotFree) {
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
    EXPECT_EQ(NumUnexplained(maker, kTarget), is_hidden ? 0U : 100U);
  }
}

TEST(OccupancyOfRecording, AFartherObjectHidesNothing) {
  const RecordingMaker maker = MakeFrames(240, [](int i, RecordingMaker* m) {
    m->AddBox({30.0, -9.0, -3.0}, {30.05, 9.0, 6.0}, 1000, kWall);
    if (i >= 100 && i < 120) m->AddBlob({20.0, 0.0, 1.0}, 0.2, 5, kTarget);
  });
  EXPECT_EQ(NumUnexplained(maker, kTarget), 100U);
}

TEST(OccupancyOfRecording, VerdictsDoNotDependOnTheirOrder) {
  for (std::uint32_t seed = 0; seed < testing::Draws(6U); ++seed) {
    const RecordingMaker maker = DrawnRecording(seed);
    LearnedOccupancy learned(maker.recording);
    LearnedOccupancy again(maker.recording);
    const std::vector<Occupancy::Verdict> verdicts = learned.Verdicts(maker.recording);
    for (std::size_t i = verdicts.size(); i-- > 0;) {
      for (LearnedOccupancy* occupancy : {&learned, &again}) {
        const Occupancy::Verdict verdict = occupancy->Judge(maker.recording, i);
        EXPECT_EQ(verdict.is_structure, verdicts[i].is_structure) << seed << ' ' << i;
        EXPECT_EQ(verdict.place_rate, verdicts[i].place_rate) << seed << ' ' << i;
        EXPECT_EQ(verdict.dwell_begin_bin, verdicts[i].dwell_begin_bin) << seed << ' ' << i;
      }
    }
  }
}

// One dwell is known by the time outside it, of the other too little is known.
TEST(OccupancyOfRecording, ADwellIsNotJudgedByTheTimeOutsideAnother) {
  const Eigen::Vector3d place_m(15.0, 3.0, 8.0);
  for (const bool is_reverse : {false, true}) {
    const RecordingMaker maker = MakeFrames(500, [&](int i, RecordingMaker* m) {
      const int at = is_reverse ? 499 - i : i;
      if (at == 2 || (at > 35 && at % 20 == 2)) m->Add(place_m, kTarget);
    });
    LearnedOccupancy learned(maker.recording);
    const std::size_t n = maker.labels.size();
    const std::size_t single = is_reverse ? n - 1 : 0;
    for (std::size_t k = 0; k < 2 * n; ++k) {
      const std::size_t i = k < n ? k : 2 * n - 1 - k;
      EXPECT_EQ(learned.Judge(maker.recording, i).is_structure, i != single) << is_reverse << k;
    }
  }
}

TEST(OccupancyOfRecording, RateOutsideIsThatOfBruteForce) {
  RecordingMaker maker = MakeFrames(100, [](int, RecordingMaker* m) {
    m->AddBox({5, -10, 0}, {25, 10, 10}, 60);
    AddWall(m);
  });
  const Recording& recording = maker.recording;
  const BackgroundConfig config;
  const LearnedOccupancy learned(recording);
  ASSERT_EQ(learned.bins().num_bins(), 20U);
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::Vector3f place_m = maker.random.InBox({0, -12, -2}, {30, 12, 12}).cast<float>();
    const std::uint32_t first = maker.random.Index(20);
    const std::uint32_t last = first + maker.random.Index(10);  // beyond the end, or of none
    double num_outside = 0.0;
    double num_hit = 0.0;
    double num_hit_outside = 0.0;
    double num_returns = 0.0;
    for (std::uint32_t bin = 0; bin < 20; ++bin) {
      const bool is_outside = bin < first || bin >= last;
      double in_bin = 0.0;
      for (std::uint32_t i = recording.frames[5 * bin].first_return;
           i < recording.frames[5 * bin + 4].last_return; ++i) {
        in_bin += IsNeighbour(config.place, place_m, recording.points_m[i]) ? 1.0 : 0.0;
      }
      num_returns += in_bin;
      num_outside += is_outside ? 1.0 : 0.0;
      num_hit += in_bin > 0.0 ? 1.0 : 0.0;
      num_hit_outside += is_outside && in_bin > 0.0 ? 1.0 : 0.0;
    }
    // As if each of these bins of five frames had equally many returns.
    const double outside = num_returns * num_hit_outside / std::max(num_hit, 1.0);
    const double expected = std::max(outside, 0.5) / (5.0 * num_outside) /
                            testing::BlockVolumeM3(config.place, place_m);
    EXPECT_NEAR(learned.occupancy().RateOutside(place_m, first, last), expected, 1e-9 * expected)
        << place_m.transpose() << ' ' << first << ' ' << last;
  }
}

TEST(OccupancyOfRecording, RateOutsideIsUnknownWhereHardlyAnyTimeIsLeft) {
  const RecordingMaker maker = MakeFrames(100, [](int, RecordingMaker* m) { AddWall(m); });
  const LearnedOccupancy learned(maker.recording);
  const auto rate_outside = [&](std::uint32_t first, std::uint32_t last) {
    return learned.occupancy().RateOutside({20.0F, 0.0F, 1.0F}, first, last);
  };
  EXPECT_LT(rate_outside(0, 20), 0.0);
  EXPECT_LT(rate_outside(1, 20), 0.0);
  EXPECT_LT(rate_outside(2, 20), 0.0);
  EXPECT_GT(rate_outside(3, 20), 0.0);  // 15 % of the time
}

TEST(OccupancyOfRecording, APauseIsNoTimeInWhichAPlaceWasEmpty) {
  constexpr double kYear_s = 365.0 * 86400.0;
  for (const double pause_s : {2.5, 60.0, 40.0 * kYear_s}) {
    RecordingMaker maker(2);
    for (int i = 0; i < 120; ++i) {
      maker.BeginFrame(i * kPeriodS + (i < 60 ? 0.0 : pause_s));
      AddWall(&maker);
      maker.AddBlob({15.0, 3.0 * (MiddleS(i) - 6.0), 8.0}, 0.1, 5, kTarget);
    }
    EXPECT_EQ(NumUnexplained(maker, kWall), 0U) << pause_s;
    EXPECT_EQ(NumUnexplained(maker, kTarget), NumOf(maker, kTarget)) << pause_s;
  }
}

TEST(OccupancyOfRecording, APauseEndsNoDwell) {
  // There for the last four seconds before and the first four after.
  for (const double pause_s : {0.0, 2.5, 60.0}) {
    RecordingMaker maker(3);
    for (int i = 0; i < 120; ++i) {
      maker.BeginFrame(i * kPeriodS + (i < 60 ? 0.0 : pause_s));
      if (i >= 20 && i < 100) maker.AddBlob({15.0, 0.0, 8.0}, 0.1, 5, kTarget);
    }
    EXPECT_EQ(NumUnexplained(maker, kTarget), 400U) << pause_s;
  }
}

TEST(OccupancyOfRecording, AWallIsStructureAlsoInBurstsOfFramesBetweenLongPauses) {
  RecordingMaker maker(3);
  for (int i = 0; i < 120; ++i) {
    maker.BeginFrame(i * kPeriodS + 60.0 * (i / 4));
    AddWall(&maker);
  }
  EXPECT_EQ(NumUnexplained(maker, kWall), 0U);
}

TEST(OccupancyOfRecording, PlaceRateIsThatOfAPoissonProcessThatHitsSoManyOtherBins) {
  constexpr int kFrames = 300;
  const Eigen::Vector3d place_m(15.0, 3.0, 8.0);
  BackgroundConfig config;
  config.max_dwell_gap_s = 0.0;  // every hit is a dwell of its own
  double before = 0.0;
  for (const int spacing : {100, 30, 20, 10, 6, 4, 3}) {  // bins from hit to hit
    int num_hits = 0;
    const RecordingMaker maker = MakeFrames(kFrames, [&](int i, RecordingMaker* m) {
      if (i % (5 * spacing) != 2) return;
      m->Add(place_m, kTarget);
      ++num_hits;
    });
    LearnedOccupancy learned(maker.recording, config);
    const auto num_bins = static_cast<double>(learned.bins().num_bins());
    const double others = num_hits - 1.0;
    // Of the others one may be a passing target's.
    const double hits_per_frame =
        -std::log(1.0 - std::max(0.0, others - 1.0) / (num_bins - 1.0)) / (kFrames / num_bins);
    const double expected =
        hits_per_frame / testing::BlockVolumeM3(config.place, place_m.cast<float>());
    for (const Occupancy::Verdict& verdict : learned.Verdicts(maker.recording)) {
      EXPECT_FALSE(verdict.is_structure) << spacing;
      EXPECT_NEAR(static_cast<double>(verdict.place_rate), expected, 1e-3 * expected) << spacing;
    }
    if (others <= 1.0) {
      EXPECT_EQ(expected, 0.0);
    } else {
      EXPECT_GT(expected, before);
    }
    before = expected;
  }
}

TEST(OccupancyOfRecording, PlaceRateOfStructureAndOfWhatPassesIsZero) {
  const RecordingMaker maker = MakeFrames(120, [](int i, RecordingMaker* m) {
    AddWall(m);
    m->AddBlob({15.0, 5.0 * (MiddleS(i) - 6.0), 1.0}, 0.1, 5, kTarget);
  });
  LearnedOccupancy learned(maker.recording);
  for (const Occupancy::Verdict& verdict : learned.Verdicts(maker.recording)) {
    EXPECT_EQ(verdict.place_rate, 0.0F);
  }
}

// Looks along x in every sixth bin, where a thing stands, and to five other sides.
void PanPast(const Eigen::Vector3f& place_m, bool has_poses, Occupancy* occupancy) {
  for (std::int64_t bin = 0; bin < 60; ++bin) {
    CarrierPose carrier;
    if (has_poses) {
      const auto azimuth_rad = static_cast<float>(bin % 6) * static_cast<float>(M_PI) / 3.0F;
      carrier.rotation = Eigen::AngleAxisf(azimuth_rad, Eigen::Vector3f::UnitZ());
    }
    std::vector<Eigen::Vector3f> points_m;
    for (int k = -4; k <= 4; ++k) {  // 40 degrees of ground and of a hill far away
      const auto side_rad =
          static_cast<float>(0.09 * k + static_cast<double>(bin % 6) * M_PI / 3.0);
      points_m.emplace_back(10.0F * std::cos(side_rad), 10.0F * std::sin(side_rad), -3.0F);
      points_m.emplace_back(90.0F * std::cos(side_rad), 90.0F * std::sin(side_rad), 40.0F);
    }
    if (bin % 6 == 0) points_m.push_back(place_m);
    occupancy->AddFrame(points_m, bin, carrier);
  }
}

TEST_F(OccupancyTest, WhatIsOutOfViewOfACarrierThatTurnsIsNotEmpty) {
  const Eigen::Vector3f place_m(15.0F, 0.0F, 3.0F);
  PanPast(place_m, false, &occupancy_);
  EXPECT_FALSE(JudgeOne(&occupancy_, place_m, 30).is_structure);
  Occupancy with_poses{BackgroundConfig()};
  PanPast(place_m, true, &with_poses);
  EXPECT_TRUE(JudgeOne(&with_poses, place_m, 30).is_structure);
}

// Drives along x past what it sees from less than 20 m alone, and something that passes in front.
TEST_F(OccupancyTest, WhatComesIntoRangeOfACarrierHasNotCome) {
  const auto drive = [](bool has_poses, Occupancy* occupancy) {
    const Eigen::Vector3f pole_m(60.0F, 4.0F, 2.0F);
    for (std::int64_t bin = 0; bin < 40; ++bin) {
      CarrierPose carrier;
      const Eigen::Vector3f at_m(1.5F * static_cast<float>(bin), 0.0F, 0.0F);
      if (has_poses) carrier.shift_m = at_m;
      std::vector<Eigen::Vector3f> points_m;
      for (int k = 0; k < 72; ++k) {
        const auto side_rad = static_cast<float>(k * M_PI / 36.0);
        points_m.emplace_back(
            at_m + Eigen::Vector3f(12.0F * std::cos(side_rad), 12.0F * std::sin(side_rad), -3.0F));
        points_m.emplace_back(
            at_m + Eigen::Vector3f(80.0F * std::cos(side_rad), 80.0F * std::sin(side_rad), 60.0F));
      }
      if ((pole_m - at_m).norm() < 20.0F) points_m.push_back(pole_m);
      const Eigen::Vector3f ahead_m = at_m + Eigen::Vector3f(8.0F, 1.0F, 3.0F);
      if (bin == 35) points_m.push_back(ahead_m);
      occupancy->AddFrame(points_m, bin, carrier);
    }
    const Eigen::Vector3f ahead_m(1.5F * 35.0F + 8.0F, 1.0F, 3.0F);
    return std::pair(JudgeOne(occupancy, pole_m, 35).is_structure,
                     JudgeOne(occupancy, ahead_m, 35).is_structure);
  };
  EXPECT_EQ(drive(false, &occupancy_), std::pair(false, false));
  Occupancy with_poses{BackgroundConfig()};
  EXPECT_EQ(drive(true, &with_poses), std::pair(true, false));
}

}  // namespace
}  // namespace unlidar
