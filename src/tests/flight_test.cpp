#include "tracking/flight.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {
namespace {

constexpr double kHigh_m = 2.0;  // what is not known to be in the air has to be as high

RobustConfig Config() {
  RobustConfig config;
  config.off_ground_m = kHigh_m;
  config.false_alarms_per_recording = 1e-3;
  return config;
}

// Frames of some returns at some height, nothing below.
std::vector<Plot> PathAt(double height_m, int num_frames, std::uint32_t returns_per_frame) {
  Plot plot;
  plot.lowest_m = height_m;
  plot.num_returns = returns_per_frame;
  return std::vector<Plot>(static_cast<std::size_t>(num_frames), plot);
}

bool IsKnownToBeInTheAir(const std::vector<Plot>& path, const Recording& recording = {},
                         const Queue<BodyBox>& bodies = {}) {
  return HasNothingBelow(recording, path, bodies, Config());
}

void SetPeriod(TimeNs period_ns, std::vector<Plot>* path) {
  for (std::size_t i = 0; i < path->size(); ++i) {
    (*path)[i].time_ns = (*path)[i].frame_time_ns = static_cast<TimeNs>(i) * period_ns;
  }
}

TEST(Flight, WhatHasNothingBelowItInEnoughReturnsIsInTheAir) {
  EXPECT_TRUE(IsKnownToBeInTheAir(PathAt(1.4, 8, 3)));
  EXPECT_FALSE(IsKnownToBeInTheAir(PathAt(1.4, 5, 1)));
}

TEST(Flight, TheHigherItIsTheFewerReturnsItTakes) {
  int before = 1000;
  for (const double height_m : {0.8, 1.0, 1.3, 1.8}) {
    int num_frames = 1;
    while (!IsKnownToBeInTheAir(PathAt(height_m, num_frames, 1))) ++num_frames;
    EXPECT_LT(num_frames, before) << height_m;
    before = num_frames;
  }
}

// Where there is no room for legs none are missed.
TEST(Flight, WhatLiesOnTheGroundIsNeverInTheAir) {
  EXPECT_FALSE(IsKnownToBeInTheAir(PathAt(0.3, 1000, 10)));
}

// Heads and shoulders, their legs in two frames of three.
TEST(Flight, WhatStandsOnTheGroundIsNeverInTheAir) {
  for (const int num_frames : {9, 30, 300}) {
    for (const std::uint32_t returns_per_frame : {3U, 100U}) {
      std::vector<Plot> path = PathAt(1.3, num_frames, returns_per_frame);
      for (std::size_t i = 0; i < path.size(); ++i) path[i].num_below = i % 3 == 0 ? 0 : 4;
      EXPECT_FALSE(IsKnownToBeInTheAir(path)) << num_frames << ", " << returns_per_frame;
    }
  }
}

// Between two beams of a spinning sensor there may be the lower part of a car.
TEST(Flight, WhatNoBeamLooksBelowIsNotKnownToBeInTheAir) {
  std::vector<Plot> path = PathAt(1.4, 8, 3);
  for (Plot& plot : path) plot.watched_below = 0.5;
  EXPECT_TRUE(IsKnownToBeInTheAir(path));
  path = PathAt(1.4, 300, 3);
  for (Plot& plot : path) plot.watched_below = 0.0;
  EXPECT_FALSE(IsKnownToBeInTheAir(path));
}

// A wall hides the lower part of a car all along its path, wherever a frame shows the wall.
TEST(Flight, WhatIsSeenAboveAWallIsNotKnownToBeInTheAir) {
  std::vector<Plot> path = PathAt(1.4, 20, 10);
  for (std::size_t i = 0; i < path.size(); i += 2) path[i].num_before_below = 4;
  EXPECT_FALSE(IsKnownToBeInTheAir(path));
  for (std::size_t i = 1; i < path.size(); i += 2) path[i].num_behind_below = 4;  // a gap
  EXPECT_TRUE(IsKnownToBeInTheAir(path));
  for (Plot& plot : path) plot.num_behind_below = 40;  // wires
  EXPECT_TRUE(IsKnownToBeInTheAir(path));
}

// The line on which a sensor draws a car is high in one frame and low in the next.
TEST(Flight, WhatIsSeenLowASplitSecondLaterIsNotKnownToBeInTheAir) {
  std::vector<Plot> path = PathAt(1.4, 30, 3);
  for (std::size_t i = 0; i < path.size(); i += 3) path[i].lowest_m = 0.4;
  SetPeriod(100'000'000, &path);
  EXPECT_FALSE(IsKnownToBeInTheAir(path));
  SetPeriod(500'000'000, &path);  // a drone climbs and sinks so fast
  EXPECT_TRUE(IsKnownToBeInTheAir(path));
}

// Where legs are seen as well as a head, they are a body, and the path has no plot.
TEST(Flight, WhatIsABodyBetweenItsPlotsIsNotKnownToBeInTheAir) {
  std::vector<Plot> path = PathAt(1.4, 8, 3);
  SetPeriod(800'000'000, &path);
  for (std::size_t i = 0; i < path.size(); ++i) {
    path[i].position_m = Eigen::Vector3d(10.0, static_cast<double>(i), 0.0);
  }
  const auto bodies_at = [&](const Eigen::Vector3f& top_m) {
    Queue<BodyBox> bodies;
    for (std::size_t i = 0; i + 1 < path.size(); ++i) {
      const Eigen::Vector3f at_m = top_m + Eigen::Vector3f(0, static_cast<float>(i) + 0.5F, 0);
      bodies.push_back({path[i].time_ns + 400'000'000,
                        at_m.array() - Eigen::Array3f(0.2F, 0.2F, 1.3F),
                        at_m.array() + Eigen::Array3f(0.2F, 0.2F, 0.0F)});
    }
    return bodies;
  };
  EXPECT_TRUE(IsKnownToBeInTheAir(path));
  EXPECT_FALSE(IsKnownToBeInTheAir(path, {}, bodies_at({10.0F, 0.0F, 0.1F})));
  EXPECT_TRUE(IsKnownToBeInTheAir(path, {}, bodies_at({14.0F, 0.0F, 0.1F})));  // beside it
  EXPECT_TRUE(IsKnownToBeInTheAir(path, {}, bodies_at({10.0F, 0.0F, 1.1F})));  // no lower
  SetPeriod(1'600'000'000, &path);  // by then it may be anywhere
  EXPECT_TRUE(IsKnownToBeInTheAir(path, {}, bodies_at({10.0F, 0.0F, 0.1F})));
}

// They may be strays that join two cars.
TEST(Flight, WhatIsHigherThanABodySaysNothingOfWhatIsLower) {
  std::vector<Plot> path = PathAt(1.4, 5, 1);
  const std::vector<Plot> high = PathAt(30.0, 100, 3);
  path.insert(path.end(), high.begin(), high.end());
  EXPECT_FALSE(IsKnownToBeInTheAir(path));
}

TEST(Flight, ACarThatPassesBelowOnceDoesNotMakeABody) {
  std::vector<Plot> path = PathAt(1.4, 10, 3);
  path[4].num_below = 60;
  EXPECT_TRUE(IsKnownToBeInTheAir(path));
}

// A flight past something as high as legs, ten plots a metre apart in twenty frames: three of them
// have returns below.
class Passing {
 public:
  static constexpr std::uint32_t kNumFrames = 20;
  static constexpr std::uint32_t kNumPlots = 10;
  static constexpr std::uint32_t kFirstAbove = 4;
  static constexpr std::uint32_t kLastAbove = 6;
  static constexpr double kHeight_m = 1.4;
  static constexpr double kStep_m = 1.0;

  Passing() {
    path = PathAt(kHeight_m, kNumPlots, 2);
    for (std::uint32_t i = 0; i < kNumPlots; ++i) {
      path[i].frame = i;
      path[i].frame_time_ns = TimeOf(i);
      path[i].position_m = {10.0, kStep_m * i, kHeight_m};
      path[i].column_m = static_cast<float>(kHeight_m - 0.25);
      path[i].num_below = IsAbove(i) ? 3 : 0;
    }
    recording.sensors.resize(1);
  }

  static bool IsAbove(std::uint32_t plot) { return kFirstAbove <= plot && plot <= kLastAbove; }

  // Appends the frames, each with what `is_hit` says is below the plots.
  template <typename IsHit>
  void AddFrames(const IsHit& is_hit) {
    for (std::uint32_t f = 0; f < kNumFrames; ++f) {
      FrameInfo frame;
      frame.begin_ns = frame.end_ns = TimeOf(f);
      frame.first_return = static_cast<std::uint32_t>(recording.points_m.size());
      recording.points_m.emplace_back(30.0F, 0.0F, 5.0F);  // something far away
      for (std::uint32_t plot = kFirstAbove; plot <= kLastAbove; ++plot) {
        if (!is_hit(f, plot)) continue;
        recording.points_m.emplace_back(10.1F, static_cast<float>(kStep_m * plot), 0.6F);
      }
      frame.last_return = static_cast<std::uint32_t>(recording.points_m.size());
      recording.frames.push_back(frame);
    }
  }

  Recording recording;
  std::vector<Plot> path;

 private:
  static TimeNs TimeOf(std::uint32_t frame) { return 500'000'000LL * frame; }
};

TEST(Flight, WhatStandsBelowAlsoWhileTheTargetIsElsewhereIsNoBodyOfIt) {
  Passing bollards;
  bollards.AddFrames([](std::uint32_t, std::uint32_t) { return true; });
  EXPECT_TRUE(IsKnownToBeInTheAir(bollards.path, bollards.recording));
  // A stream does not keep what it would take to know.
  EXPECT_FALSE(IsKnownToBeInTheAir(bollards.path));
}

TEST(Flight, WhatIsBelowOnlyWithTheTargetIsItsBody) {
  Passing legs;
  legs.AddFrames([](std::uint32_t frame, std::uint32_t plot) { return frame == plot; });
  EXPECT_FALSE(IsKnownToBeInTheAir(legs.path, legs.recording));
}

// A long body reaches below the plot from where the path is next to it.
TEST(Flight, WhatIsBelowOnlyNextToTheTargetIsItsBody) {
  Passing body;
  body.AddFrames([](std::uint32_t frame, std::uint32_t plot) {
    return frame <= plot + 3 && plot <= frame + 3;
  });
  EXPECT_FALSE(IsKnownToBeInTheAir(body.path, body.recording));
}

// Where it stands at last nobody can tell what is there without it.
TEST(Flight, WhatStaysWhereThePathEndsIsItsBody) {
  Passing walk;
  walk.path.resize(Passing::kLastAbove + 1);
  for (Plot& plot : walk.path) plot.num_returns = 4;
  walk.AddFrames([](std::uint32_t frame, std::uint32_t plot) { return frame >= plot; });
  EXPECT_FALSE(IsKnownToBeInTheAir(walk.path, walk.recording));
}

TEST(Flight, WhatIsOnTheGroundOrAboveThePathIsNoLegs) {
  Plot plot;
  plot.position_m = {10.0, 4.0, 1.4};
  plot.column_m = 0.5;
  const auto is_below = [&](const Eigen::Vector3d& lower_by_m) {
    Columns columns;
    columns.Add(plot);
    columns.Sort();
    bool is_below_it = false;
    columns.VisitAbove((plot.position_m - lower_by_m).cast<float>(),
                       [&](std::size_t) { is_below_it = true; });
    return is_below_it;
  };
  EXPECT_TRUE(is_below({0.3, 0.3, 0.45}));
  EXPECT_FALSE(is_below({0.3, 0.3, 0.55}));
  EXPECT_FALSE(is_below({0.3, 0.3, 0.3}));
  EXPECT_FALSE(is_below({0.5, 0.5, 0.45}));
}

constexpr std::uint32_t kNumPlots = 20;

bool Never(const std::vector<std::uint32_t>& /*numbers*/) { return false; }

// Twenty frames of a path, one a metre of the way of its sensor, if that travels. `height_m`: of
// each plot over ground; `num_on_structure`: of the first plots, above structure.
Rejection RejectionOf(const Eigen::Vector3d& step_m, bool travels,
                      const std::vector<double>& height_m = std::vector<double>(kNumPlots, 10.0),
                      const ReachesThreshold& reaches_threshold = Never,
                      std::uint32_t num_on_structure = 0) {
  Recording recording;
  recording.sensors.resize(1);
  std::vector<Plot> path;
  for (std::uint32_t k = 0; k < kNumPlots; ++k) {
    FrameInfo frame;
    frame.begin_ns = k * NsOf(0.1);
    frame.end_ns = frame.begin_ns + NsOf(0.1);
    if (travels) frame.carrier.shift_m.x() = static_cast<float>(k);
    recording.frames.push_back(frame);
    Plot plot;
    plot.frame = k;
    plot.time_ns = plot.frame_time_ns = frame.middle_ns();
    plot.shift_m = frame.carrier.shift_m;
    plot.position_m = Eigen::Vector3d(30.0, 5.0, 10.0) + k * step_m;
    plot.ray_m = plot.position_m - plot.shift_m.cast<double>();
    plot.lowest_m = height_m[k];
    plot.is_above_structure = k < num_on_structure;
    plot.num_returns = 5;
    path.push_back(plot);
  }
  return FlightRejection(recording, path, {}, reaches_threshold, Config());
}

// A car whose path goes on along strays is none of theirs.
TEST(Flight, WhatIsHighMustBeAPathByItself) {
  const Eigen::Vector3d step_m(0, 0.3, 0);
  std::vector<double> height_m(kNumPlots, 0.6);  // no room below for what would be missed
  std::fill(height_m.begin() + 6, height_m.end(), 10.0);
  std::vector<std::uint32_t> high;  // seven frames are 0.7 s: what is so near the lowest is low
  for (std::uint32_t k = 13; k < kNumPlots; ++k) high.push_back(k);
  const auto accepts = [&](const std::vector<std::uint32_t>& numbers) {
    EXPECT_EQ(numbers, high);
    return true;
  };
  EXPECT_EQ(RejectionOf(step_m, false, height_m), Rejection::kNearGround);
  EXPECT_EQ(RejectionOf(step_m, false, height_m, accepts), Rejection::kNone);
  std::fill(height_m.begin() + 6, height_m.end() - 11, 0.6);  // two plots are high, in few frames
  EXPECT_EQ(RejectionOf(step_m, false, height_m, accepts), Rejection::kNearGround);
}

// A walker on a bridge is as high above the ground as drones are.
TEST(Flight, WhatStructureMayCarryMustBeAPathByItselfAboveIt) {
  const Eigen::Vector3d step_m(0, 0.3, 0);
  const std::vector<double> height_m(kNumPlots, 10.0);
  std::vector<std::uint32_t> high(kNumPlots - 8);
  std::iota(high.begin(), high.end(), 8U);
  const auto accepts = [&](const std::vector<std::uint32_t>& numbers) {
    EXPECT_EQ(numbers, high);
    return true;
  };
  EXPECT_EQ(RejectionOf(step_m, false, height_m, Never, 0), Rejection::kNone);
  EXPECT_EQ(RejectionOf(step_m, false, height_m, Never, kNumPlots), Rejection::kOnStructure);
  EXPECT_EQ(RejectionOf(step_m, false, height_m, Never, 8), Rejection::kOnStructure);
  EXPECT_EQ(RejectionOf(step_m, false, height_m, accepts, 8), Rejection::kNone);
}

TEST(Flight, WhatHasNothingBelowItNeedOnlyBeClearOfTheGround) {
  const Eigen::Vector3d step_m(0, 0.3, 0);
  EXPECT_EQ(RejectionOf(step_m, false, std::vector<double>(kNumPlots, 1.4)), Rejection::kNone);
  EXPECT_EQ(RejectionOf(step_m, false, std::vector<double>(kNumPlots, 0.7)),
            Rejection::kNearGround);
}

TEST(Flight, WhatStandsStillIsNoneWhereItsSensorPassesBy) {
  const Eigen::Vector3d still_m(0, 0, 0);
  const Eigen::Vector3d moving_m(0, 0.3, 0);
  EXPECT_EQ(RejectionOf(still_m, false), Rejection::kNone);
  EXPECT_EQ(RejectionOf(moving_m, false), Rejection::kNone);
  EXPECT_EQ(RejectionOf(still_m, true), Rejection::kStationary);
  EXPECT_EQ(RejectionOf(moving_m, true), Rejection::kNone);
}

TEST(Flight, WhatIsPassedAtRestMayBeSeenAtAnyHeight) {
  const Eigen::Vector3d up_m(0, 0, 0.3);
  EXPECT_EQ(RejectionOf(up_m, false), Rejection::kNone);
  EXPECT_EQ(RejectionOf(up_m, true), Rejection::kStationary);
  EXPECT_EQ(RejectionOf(-up_m, true), Rejection::kStationary);
  EXPECT_EQ(RejectionOf(up_m + Eigen::Vector3d(0, 0.3, 0), true), Rejection::kNone);
}

}  // namespace
}  // namespace unlidar
