#include "live/occupancy.hpp"

#include <gtest/gtest.h>

#include "live/fading_grid.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

bool NeverFloats(const Eigen::Vector3f&) { return false; }

class OccupancyTest : public ::testing::Test {
 protected:
  // A bin of five frames in which a place is hit or not.
  void Bin(std::int64_t bin, bool is_hit, const Eigen::Vector3f& place_m = {10, 5, 3}) {
    for (int frame = 0; frame < 5; ++frame) occupancy_.AddFrame(bin);
    if (is_hit) occupancy_.Add(place_m, bin);
  }

  bool IsStructure(std::int64_t bin, const Eigen::Vector3f& place_m = {10, 5, 3}) {
    return occupancy_.Judge(place_m, bin, 0, NeverFloats).is_structure;
  }

  std::vector<Eigen::Vector3f> Structure() const {
    std::vector<Eigen::Vector3f> points_m;
    occupancy_.GetStructure(&points_m);
    return points_m;
  }

  std::vector<Eigen::Vector3f> Supporters() const {
    std::vector<Eigen::Vector3f> points_m;
    occupancy_.GetSupporters(&points_m);
    return points_m;
  }

  Occupancy occupancy_{BackgroundConfig()};
};

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
      return occupancy_.Judge(place_m, bin, 0, NeverFloats, is_target).is_structure;
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
  for (std::int64_t bin = 0; bin < 120; ++bin) {
    Bin(bin, bin < 4 || (bin >= 40 && bin % 2 == 0));
    const Occupancy::Verdict verdict = occupancy_.Judge({10, 5, 3}, bin, 0, NeverFloats);
    if (bin >= 40 && bin < 100) {
      EXPECT_EQ(verdict.dwell_begin_bin, 40) << bin;
    } else if (bin >= 110) {
      EXPECT_FALSE(verdict.dwell_begin_bin) << bin;
    }
  }
}

// The rays hit a pole here and there: what is older than the window counts as that in it does.
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

// By chance its stays last for longer than the window, or break.
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
    for (int k = 0; k < 50; ++k) {
      const Eigen::Vector3f flake_m =
          place_m + Eigen::Vector3f(static_cast<float>(random.Uniform(-3.0, 3.0)),
                                    static_cast<float>(random.Uniform(-3.0, 3.0)),
                                    static_cast<float>(random.Uniform(-3.0, 3.0)));
      if ((flake_m - place_m).norm() > 1.2F) occupancy_.Add(flake_m, bin);
    }
    for (int k = -20; k < 20; ++k) {
      occupancy_.Add(by_wall_m + Eigen::Vector3f(-1.8F, 0.1F * static_cast<float>(k), 0.0F), bin);
    }
  }
  const double per_frame_m3 = 50.0 / 5.0 / 216.0;
  EXPECT_GT(occupancy_.RateAround(place_m, 59), 0.3 * per_frame_m3);
  EXPECT_LT(occupancy_.RateAround(place_m, 59), 3.0 * per_frame_m3);
  EXPECT_EQ(occupancy_.RateAround(by_wall_m, 59), 0.0);
  EXPECT_EQ(occupancy_.RateAround({0, -20, 8}, 59), 0.0);
}

TEST_F(OccupancyTest, AStayThatOutlastsTheWindowDoesNotBecomeStructure) {
  for (std::int64_t bin = 0; bin < 20; ++bin) Bin(bin, false);
  for (std::int64_t bin = 20; bin < 1000; ++bin) {
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

TEST_F(OccupancyTest, SweepingForgetsWhatIsNoStructureOnly) {
  Bin(0, true, {0, 20, 8});
  for (std::int64_t bin = 0; bin < 200; ++bin) Bin(bin, bin % 3 != 0);
  IsStructure(199);
  occupancy_.Sweep();
  EXPECT_TRUE(IsStructure(199));
  EXPECT_EQ(Structure().size(), 1U);
  // A return at the forgotten place is something new.
  occupancy_.Add({0, 20, 8}, 199);
  EXPECT_FALSE(IsStructure(199, {0, 20, 8}));
}

TEST_F(OccupancyTest, TheRateOfAPlaceIsThatOfItsHitsOutsideTheStay) {
  for (std::int64_t bin = 0; bin < 60; ++bin) Bin(bin, bin % 10 == 0);
  Bin(60, true);
  const Occupancy::Verdict verdict = occupancy_.Judge({10, 5, 3}, 60, 0, NeverFloats);
  EXPECT_FALSE(verdict.is_structure);
  EXPECT_GT(verdict.place_rate, 0.0F);
}

TEST(FadingGrid, CountsWhatIsInTheNeighbourhoodAndForgetsItInTime) {
  Random random(1);
  FadingGrid grid({1.0, 0.01}, 10.0);
  for (int i = 0; i < 100; ++i) grid.Add({20, 5, 5}, 0.0);
  for (int i = 0; i < 100; ++i)
    grid.Add(random.InBox({-40, 20, 0}, {-20, 40, 20}).cast<float>(), 0.0);
  EXPECT_NEAR(grid.CountAt({20, 5, 5}, 0.0), 100.0, 1e-9);
  EXPECT_NEAR(grid.CountAt({20, 5, 5}, 10.0), 100.0 * std::exp(-1.0), 1e-9);
  EXPECT_NEAR(grid.CountAt({20.3F, 5, 5}, 0.0), 100.0, 1e-9);
  EXPECT_EQ(grid.CountAt({23, 5, 5}, 0.0), 0.0);
  grid.Sweep(1e4);
  EXPECT_EQ(grid.CountAt({20, 5, 5}, 0.0), 0.0);
}

}  // namespace
}  // namespace unlidar
