// The cross-section of a path that is enough for a drone.
#include "tracking/cross_section.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <vector>

#include "tracking/flight.hpp"

namespace unlidar {
namespace {

struct Echo {
  std::uint32_t num_returns;
  double range_m;
};

// Ten frames a second of `per_sr` lines of sight, each with a plot of the path.
struct Seen {
  Seen(const std::vector<Echo>& echoes, double per_sr) {
    recording.sensors.resize(1);
    for (std::uint32_t k = 0; k < echoes.size(); ++k) {
      FrameInfo frame;
      frame.begin_ns = k * NsOf(0.1);
      frame.end_ns = frame.begin_ns + NsOf(0.1);
      recording.frames.push_back(frame);
      if (echoes[k].num_returns == 0) continue;
      Plot plot;
      plot.frame = k;
      plot.time_ns = frame.middle_ns();
      plot.position_m = plot.ray_m = {echoes[k].range_m, 0.0, 0.0};
      plot.lowest_m = 10.0;
      plot.num_returns = echoes[k].num_returns;
      plot.sights_per_sr = static_cast<float>(per_sr);
      path.push_back(plot);
    }
  }

  Rejection RejectionOf(const ReachesThreshold& reaches_threshold) const {
    return FlightRejection(recording, path, {}, reaches_threshold, RobustConfig());
  }

  Recording recording;
  std::vector<Plot> path;
};

bool Never(const Members& /*numbers*/) { return false; }

// The area whose lines of sight return: the same at any range, before any sensor.
TEST(CrossSection, OfALeafIsThatOfNoDrone) {
  for (const double range_m : {8.0, 30.0}) {
    for (const std::uint32_t num_returns : {1U, 5U, 40U}) {
      for (const double cross_section_m2 : {0.003, 0.0057, 0.0063, 0.02}) {
        const double per_sr = num_returns * range_m * range_m / cross_section_m2;
        const Seen seen(std::vector<Echo>(20, {num_returns, range_m}), per_sr);
        for (const double found_m2 : CrossSectionsM2(seen.recording, seen.path)) {
          EXPECT_NEAR(found_m2, cross_section_m2, 1e-6);
        }
        const bool is_leaf = cross_section_m2 < 0.006;
        EXPECT_EQ(seen.RejectionOf(Never), is_leaf ? Rejection::kWeakReturn : Rejection::kNone)
            << num_returns << " at " << range_m << " m: " << cross_section_m2;
      }
    }
  }
}

TEST(CrossSection, FramesOfAShortPauseCount) {
  std::vector<Echo> echoes;
  for (int k = 0; k < 60; ++k) echoes.push_back({k % 4 == 0 ? 1U : 0U, 10.0});
  const Seen seen(echoes, 5'000.0);
  for (const double found_m2 : CrossSectionsM2(seen.recording, seen.path)) {
    EXPECT_NEAR(found_m2, 0.25 * 100.0 / 5'000.0, 0.0007);
  }
}

// Before a clear sky few return, but a LiDAR has 25,000 a second and steradian at least.
TEST(CrossSection, LinesOfSightThatDoNotReturnCount) {
  const auto rejection_at = [](double range_m) {
    return Seen(std::vector<Echo>(20, {1, range_m}), 10.0).RejectionOf(Never);
  };
  EXPECT_EQ(rejection_at(3.7), Rejection::kWeakReturn);
  EXPECT_EQ(rejection_at(4.0), Rejection::kNone);
}

// A path that goes on from an insect near the sensor to a drone has enough of the drone.
TEST(CrossSection, IsThatOfEachPartOfAPath) {
  std::vector<Echo> echoes(60, {1, 2.0});
  echoes.insert(echoes.end(), 60, {4, 12.0});
  const Seen seen(echoes, 8'000.0);
  const auto accepts = [](const Members& numbers) {
    EXPECT_GE(numbers.front(), 30U);
    EXPECT_LE(numbers.front(), 89U);  // three seconds after the first plot of the drone
    EXPECT_EQ(numbers.back(), 119U);
    return true;
  };
  EXPECT_EQ(seen.RejectionOf(accepts), Rejection::kNone);
  EXPECT_EQ(seen.RejectionOf(Never), Rejection::kWeakReturn);
}

}  // namespace
}  // namespace unlidar
