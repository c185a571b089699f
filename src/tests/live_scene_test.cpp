#include "live/live_scene.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::Random;

constexpr TimeNs kEndless = std::numeric_limits<TimeNs>::max();
constexpr int kWarmFrames = 31;  // they take 3 s

Eigen::Vector3d DroneAt(int i) { return {12.0, -8.0 + 0.2 * i, 6.0}; }

Eigen::Vector3d SlowDroneAt(int i) { return {12.0, -8.0 + 0.03 * i, 6.0}; }

// Ground with a drone above it, from a station that stands somewhere. The coordinates are so coarse
// that moving them is exact.
class Station {
 public:
  Station(std::uint32_t sensor, const Eigen::Vector3f& origin_m)
      : random_(1), sensor_(sensor), origin_m_(origin_m) {}

  // Another drone, and how often a pole is hit that stands where it begins.
  Station(Eigen::Vector3d (*drone_at)(int), int num_pole_returns) : Station(0, {0, 0, 0}) {
    drone_at_ = drone_at;
    num_pole_returns_ = num_pole_returns;
  }

  LoadedFrame FrameAt(int i) {
    LoadedFrame frame;
    frame.info = testing::FrameAt(i);
    frame.info.sensor = sensor_;
    for (int k = 0; k < 300; ++k) {
      const double range_m = random_.Uniform(3.0, 30.0);
      const double azimuth = random_.Uniform(-M_PI, M_PI);
      Add({range_m * std::cos(azimuth), range_m * std::sin(azimuth), -2.0}, &frame);
    }
    for (int k = 0; k < 4; ++k) Add(drone_at_(i) + random_.NormalVector(0.1), &frame);
    for (int k = 0; k < num_pole_returns_; ++k) {
      Add({12.0, -8.0, random_.Uniform(-2.0, 4.5)}, &frame);
    }
    frame.times_ns.assign(frame.points_m.size(), frame.info.middle_ns());
    return frame;
  }

 private:
  void Add(const Eigen::Vector3d& point_m, LoadedFrame* frame) {
    const Eigen::Array3d steps = (point_m.array() * 1024.0).round();
    frame->points_m.push_back((steps / 1024.0).matrix().cast<float>() + origin_m_);
  }

  Random random_;
  std::uint32_t sensor_;
  Eigen::Vector3f origin_m_;
  Eigen::Vector3d (*drone_at_)(int) = DroneAt;
  int num_pole_returns_ = 0;
};

bool Take(LiveScene* scene, LoadedFrame frame) { return scene->Take(&frame); }

// All frames that the scene leaves, taken as they come.
std::vector<SceneFrame> FramesOf(LiveScene* scene, Station* station, int count) {
  std::vector<SceneFrame> frames;
  const auto take = [&](TimeNs until_ns) {
    SceneFrame frame;
    while (scene->Next(until_ns, &frame)) frames.push_back(frame);
  };
  for (int i = 0; i < count; ++i) {
    if (!Take(scene, station->FrameAt(i))) continue;
    while (scene->num_waiting() > 0) take(scene->MakePlots() - kPeriodNs);
  }
  scene->Close();
  while (scene->num_waiting() > 0) scene->MakePlots();
  take(kEndless);
  return frames;
}

// The same of one sensor at the origin.
std::vector<SceneFrame> FramesOf(int count, Station station = {0, Eigen::Vector3f::Zero()},
                                 bool is_blinded = false) {
  const Config config;
  LiveScene scene(config);
  scene.SetBlinded(is_blinded);
  scene.AddSensor(0, SensorInfo());
  return FramesOf(&scene, &station, count);
}

SensorInfo StandingAt(const Eigen::Vector3f& origin_m) {
  SensorInfo info;
  info.origin_m = origin_m;
  return info;
}

// How many of the plots where the slow drone is float.
std::size_t NumFloating(const std::vector<SceneFrame>& frames) {
  std::size_t count = 0;
  for (const SceneFrame& frame : frames) {
    for (const LivePlot& seen : frame.plots) {
      if (seen.plot.position_m.z() > 5.0 && seen.plot.is_floating) ++count;
    }
  }
  return count;
}

TEST(LiveScene, IsWarmAfterThreeSecondsOrAtTheEnd) {
  const Config config;
  for (const int count : {1, 10, 60}) {
    LiveScene scene(config);
    scene.AddSensor(0, SensorInfo());
    Station station(0, Eigen::Vector3f::Zero());
    for (int i = 0; i < count; ++i) {
      EXPECT_EQ(Take(&scene, station.FrameAt(i)), i >= kWarmFrames) << i;
      EXPECT_EQ(scene.is_warm(), i + 1 >= kWarmFrames) << i;
    }
    scene.Close();
    EXPECT_TRUE(scene.is_warm());
  }
}

// Also the first, which wait until the scene is known; where it never is, nothing is searched.
TEST(LiveScene, EveryFrameLeavesItOnceInOrderAndIsSearchedInASceneThatWasWarm) {
  for (const SceneFrame& frame : FramesOf(kWarmFrames - 1)) EXPECT_FALSE(frame.is_searched());
  const std::vector<SceneFrame> frames = FramesOf(80);
  ASSERT_EQ(frames.size(), 80U);
  for (int i = 0; i < 80; ++i) {
    const SceneFrame& frame = frames[static_cast<std::size_t>(i)];
    EXPECT_EQ(frame.info.stamp_ns, kBeginNs + i * kPeriodNs);
    EXPECT_NEAR(frame.time_s, testing::MiddleS(i), 1e-9);
    EXPECT_EQ(frame.observed_s, std::max(3.0, frame.time_s));
    EXPECT_TRUE(frame.is_searched());
  }
}

TEST(LiveScene, LeavesTheDroneAndNotTheGround) {
  const std::vector<SceneFrame> frames = FramesOf(80);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    ASSERT_EQ(frames[i].plots.size(), 1U) << i;
    const Plot& plot = frames[i].plots[0].plot;
    EXPECT_LT((plot.position_m - DroneAt(static_cast<int>(i))).norm(), 0.3);
    EXPECT_EQ(plot.ray_m, plot.position_m);
    EXPECT_EQ(plot.frame, i);
  }
}

// In a stream of five seconds, without its own trail holding it up; a pole that is hit once a frame
// does.
TEST(LiveScene, WhatIsSlowFromTheBeginFloatsAsSoonAsTheSceneIsKnown) {
  EXPECT_GT(NumFloating(FramesOf(50, {SlowDroneAt, 0})), 30U);
  EXPECT_EQ(NumFloating(FramesOf(50, {SlowDroneAt, 1})), 0U);
}

// Fog may hide what holds it up.
TEST(LiveScene, WhatABlindedSensorSeesIsNotKnownToFloat) {
  EXPECT_EQ(NumFloating(FramesOf(50, {SlowDroneAt, 0}, true)), 0U);
}

// What a station sees does not depend on where it stands.
TEST(LiveScene, AStationElsewhereLeavesTheSamePlotsThere) {
  const Config config;
  const Eigen::Vector3f origin_m(64.0F, -32.0F, 4.0F);
  LiveScene here(config);
  LiveScene there(config);
  here.AddSensor(0, SensorInfo());
  there.AddSensor(0, StandingAt(origin_m));
  Station at_origin(0, Eigen::Vector3f::Zero());
  Station at_place(0, origin_m);
  const std::vector<SceneFrame> a = FramesOf(&here, &at_origin, 80);
  const std::vector<SceneFrame> b = FramesOf(&there, &at_place, 80);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(b[i].viewpoint_m, origin_m.cast<double>());
    ASSERT_EQ(a[i].plots.size(), b[i].plots.size()) << i;
    for (std::size_t k = 0; k < a[i].plots.size(); ++k) {
      const Plot& plot = b[i].plots[k].plot;
      EXPECT_EQ(plot.ray_m, a[i].plots[k].plot.ray_m);
      EXPECT_EQ(plot.log_clutter, a[i].plots[k].plot.log_clutter);
      EXPECT_EQ(plot.position_m, plot.ray_m + origin_m.cast<double>());
    }
  }
}

TEST(LiveScene, AStationThatComesLaterIsWarmLater) {
  const Config config;
  const Eigen::Vector3f origin_m(64.0F, -32.0F, 4.0F);
  LiveScene scene(config);
  scene.AddSensor(0, SensorInfo());
  scene.AddSensor(1, StandingAt(origin_m));
  Station first(0, Eigen::Vector3f::Zero());
  Station second(1, origin_m);
  constexpr int kLater = 50;
  for (int i = 0; i < 120; ++i) {
    EXPECT_EQ(Take(&scene, first.FrameAt(i)), i >= kWarmFrames) << i;
    if (i >= kLater) {
      EXPECT_EQ(Take(&scene, second.FrameAt(i)), i >= kLater + kWarmFrames) << i;
    }
    while (scene.num_waiting() > 0 && scene.is_warm()) scene.MakePlots();
    SceneFrame frame;
    while (scene.Next(kEndless, &frame)) {
      if (frame.info.sensor == 0) continue;
      const double own_s = (i - kLater + 0.5) * kPeriodS;
      EXPECT_NEAR(frame.observed_s, own_s, 1e-9) << i;
      EXPECT_EQ(frame.is_searched(), own_s > 6.0) << i;
    }
  }
}

TEST(LivePlot, ScattersAsATargetAtRestDoesOnceItsMotionIsTakenOff) {
  constexpr int kReturns = 9;
  const Eigen::Vector3d velocity_mps(9.0, -4.0, 2.0);
  Random random(5);
  Eigen::Matrix<double, 3, kReturns> rest_m;
  Eigen::Matrix<double, 1, kReturns> times_s;
  for (int k = 0; k < kReturns; ++k) {
    rest_m.col(k) = random.NormalVector(0.2);
    times_s(k) = random.Uniform(-0.05, 0.05);
  }
  rest_m.colwise() -= rest_m.rowwise().mean().eval();
  times_s.array() -= times_s.mean();
  const Eigen::Matrix<double, 3, kReturns> seen_m = rest_m + velocity_mps * times_s;
  LivePlot seen;
  seen.scatter_m2 = SymmetricMatrix(seen_m * seen_m.transpose());
  seen.time_covariance_ms = (seen_m * times_s.transpose()).cast<float>();
  seen.time_scatter_s2 = static_cast<float>(times_s.squaredNorm());
  const Eigen::Matrix3d expected_m2 = rest_m * rest_m.transpose();
  EXPECT_LT((seen.ScatterM2(velocity_mps) - expected_m2).norm(), 1e-5);
  EXPECT_GT((seen.scatter_m2.Full() - expected_m2).norm(), 0.1);
}

}  // namespace
}  // namespace unlidar
