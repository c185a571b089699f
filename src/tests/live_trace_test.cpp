#include "live/live_trace.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "live/live_engine.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::Random;

// Events of a trace, which are valid during the call only.
struct Traced {
  struct Frame {
    std::uint32_t sensor = 0;
    TimeNs stamp_ns = 0;
    std::size_t num_returns = 0;
    Rejection rejection = Rejection::kNone;
    std::size_t num_bodies = 0;
    double score_threshold = 0.0;
    std::vector<Plot> plots;
    std::vector<PathVerdict> verdicts;
  };
  struct OnePath {
    std::vector<Plot> plots;
    std::vector<PathCut> cuts;
    PathVerdict verdict;
    double score_threshold = 0.0;
  };

  std::vector<Frame> frames;
  std::vector<OnePath> paths;
  std::vector<TracedTrack> tracks;
  std::vector<TrajectoryRow> rows;

  void Add(const TracedFrame& traced) {
    Frame frame{traced.frame.info.sensor,
                traced.frame.info.stamp_ns,
                traced.frame.info.last_return - traced.frame.info.first_return,
                traced.frame.rejection,
                traced.frame.bodies_m.size(),
                traced.score_threshold,
                {},
                traced.verdicts};
    for (const LivePlot& seen : traced.frame.plots) frame.plots.push_back(seen.plot);
    frames.push_back(std::move(frame));
  }

  void Add(const TracedPath& traced) {
    OnePath path{{}, traced.cuts, traced.verdict, traced.score_threshold};
    for (const std::uint32_t i : traced.path.plots) path.plots.push_back(traced.seen[i].plot);
    paths.push_back(std::move(path));
  }

  void Add(const TracedTrack& traced) { tracks.push_back(traced); }
};

struct Scene {
  Config config;
  int num_frames = 100;
  int num_sensors = 1;
  int num_rain = 0;  // returns a frame, from the 60th on, but for these
  int first_dry = 0;
  int last_dry = -1;
  int other_from = 0;  // first frame of all sensors but the first
  // Mean of the returns of something in a frame; none: nothing.
  std::function<std::optional<Eigen::Vector3d>(int)> target;
  int num_returns = 5;
};

// Ground, a wall and the target.
PcdCloud CloudAt(const Scene& scene, int i, Random* random) {
  PcdCloud cloud;
  const auto add = [&](const Eigen::Vector3d& point_m) {
    cloud.points_m.push_back(point_m.cast<float>());
  };
  for (int k = 0; k < 600; ++k) add(random->InBox({-30, -30, -2.02}, {30, 30, -1.98}));
  for (int k = 0; k < 200; ++k) add(random->InBox({25, -10, -2}, {25.05, 10, 4}));
  const bool rains = i >= 60 && (i < scene.first_dry || i > scene.last_dry);
  for (int k = 0; rains && k < scene.num_rain; ++k) {
    add(random->InBox({-20, -20, 0}, {20, 20, 20}));
  }
  const std::optional<Eigen::Vector3d> target_m = scene.target ? scene.target(i) : std::nullopt;
  for (int k = 0; target_m && k < scene.num_returns; ++k) {
    add(*target_m + random->NormalVector(0.1));
  }
  return cloud;
}

Traced TraceOf(const Scene& scene, bool is_traced = true) {
  Traced traced;
  LiveTraceSink sink;
  if (is_traced) {
    sink = [&](const LiveTraceEvent& event) {
      std::visit([&](const auto& one) { traced.Add(one); }, event);
    };
  }
  std::vector<std::string> names;
  for (int s = 0; s < scene.num_sensors; ++s) names.push_back(std::string(1, "ab"[s]));
  LiveEngine engine(
      scene.config, names, FirstSensorStamps{},
      [&](const EngineEvent& event) {
        if (const auto* given = std::get_if<RowGiven>(&event)) traced.rows.push_back(given->row);
      },
      nullptr, std::nullopt, false, sink);
  Random random(11);
  for (int i = 0; i < scene.num_frames; ++i) {
    for (int s = 0; s < scene.num_sensors; ++s) {
      if (s > 0 && i < scene.other_from) continue;
      CloudFrame frame;
      frame.sensor = static_cast<std::uint32_t>(s);
      frame.stamp_ns = kBeginNs + i * kPeriodNs;
      frame.name = "frame";
      frame.cloud = CloudAt(scene, i, &random);
      engine.Add(std::move(frame));
    }
  }
  engine.Close();
  return traced;
}

std::optional<Eigen::Vector3d> DroneAt(int i) {
  return Eigen::Vector3d(-8.0 + 0.2 * i, 9.0, 11.0 + 0.01 * i);
}

std::optional<Eigen::Vector3d> WalkerAt(int i) {
  return Eigen::Vector3d(-8.0 + 0.15 * i, 9.0, -1.5);
}

Scene With(std::optional<Eigen::Vector3d> (*target)(int)) {
  Scene scene;
  scene.target = target;
  return scene;
}

TEST(LiveTrace, RowsAreTheSameWithAndWithout) {
  Scene scene = With(DroneAt);
  scene.num_sensors = 2;
  const std::vector<TrajectoryRow> with = TraceOf(scene).rows;
  const std::vector<TrajectoryRow> without = TraceOf(scene, false).rows;
  ASSERT_EQ(with.size(), without.size());
  EXPECT_GT(with.size(), 50U);
  for (std::size_t i = 0; i < with.size(); ++i) {
    EXPECT_EQ(with[i].time_ns, without[i].time_ns);
    EXPECT_EQ(with[i].position_m, without[i].position_m);
    EXPECT_EQ(with[i].sigma_m, without[i].sigma_m);
  }
}

TEST(LiveTrace, EveryFrameIsThereOnceInOrderWithItsReturns) {
  Scene scene = With(DroneAt);
  scene.num_sensors = 2;
  scene.other_from = 20;
  const Traced traced = TraceOf(scene);
  std::map<std::uint32_t, std::vector<TimeNs>> stamps_ns;
  for (const Traced::Frame& frame : traced.frames) {
    stamps_ns[frame.sensor].push_back(frame.stamp_ns);
    EXPECT_EQ(frame.num_returns, 805U);
    EXPECT_EQ(frame.verdicts.size(), frame.plots.size());
  }
  for (const std::uint32_t sensor : {0U, 1U}) {
    std::vector<TimeNs> expected_ns;
    for (int i = sensor == 0 ? 0 : 20; i < scene.num_frames; ++i) {
      expected_ns.push_back(kBeginNs + i * kPeriodNs);
    }
    EXPECT_EQ(stamps_ns[sensor], expected_ns);
  }
}

TEST(LiveTrace, ATrackIsInitiatedByAPathAndHasItsPlotsFromThenOn) {
  const Traced traced = TraceOf(With(DroneAt));
  ASSERT_EQ(traced.tracks.size(), 3U);
  EXPECT_EQ(traced.tracks[0].state, TrackState::kInitiated);
  EXPECT_EQ(traced.tracks[1].state, TrackState::kConfirmed);
  EXPECT_EQ(traced.tracks[2].state, TrackState::kDeleted);
  std::size_t num_initiating = 0;
  for (const Traced::OnePath& path : traced.paths) {
    EXPECT_EQ(path.verdict.rejection == Rejection::kNone, path.verdict.track.has_value());
    if (!path.verdict.track) continue;
    ++num_initiating;
    EXPECT_EQ(path.verdict.track, 0);
    EXPECT_GE(path.verdict.log_likelihood_ratio - path.verdict.crowding_penalty,
              path.score_threshold);
    for (const Plot& plot : path.plots) {
      const double i = static_cast<double>(plot.time_ns - kBeginNs) / kPeriodNs - 0.5;
      EXPECT_LT((plot.position_m - *DroneAt(static_cast<int>(std::lround(i)))).norm(), 0.5);
    }
  }
  EXPECT_EQ(num_initiating, 1U);
  for (const Traced::Frame& frame : traced.frames) {
    if (frame.stamp_ns < traced.tracks[0].at_ns) continue;
    ASSERT_EQ(frame.plots.size(), 1U);
    EXPECT_EQ(frame.verdicts[0].track, 0);
  }
}

// A path that grows is told once for each rule, and its plots each time.
TEST(LiveTrace, APathThatIsRefusedForSecondsIsTracedOnceForEachRule) {
  Scene scene = With(WalkerAt);
  scene.config.robust.disabled_rules = {Rule::kBodies};
  const Traced traced = TraceOf(scene);
  EXPECT_TRUE(traced.tracks.empty());
  std::map<Rejection, int> lines;
  for (const Traced::OnePath& path : traced.paths) ++lines[path.verdict.rejection];
  EXPECT_EQ(lines[Rejection::kNearGround], 1);
  int num_refused = 0;
  for (const Traced::Frame& frame : traced.frames) {
    for (const PathVerdict& verdict : frame.verdicts) {
      num_refused += verdict.rejection == Rejection::kNearGround ? 1 : 0;
    }
  }
  EXPECT_GT(num_refused, 50);
}

TEST(LiveTrace, PlotsHaveTheScoreOfTheirPathAgainstTheThreshold) {
  const Traced traced = TraceOf(With(DroneAt));
  int num_below = 0;
  for (const Traced::Frame& frame : traced.frames) {
    for (const PathVerdict& verdict : frame.verdicts) {
      if (verdict.track) continue;
      if (verdict.rejection == Rejection::kNone) {
        EXPECT_EQ(verdict.log_likelihood_ratio, 0.0);
      }
      if (verdict.rejection != Rejection::kBelowThreshold) continue;
      EXPECT_LT(verdict.log_likelihood_ratio, frame.score_threshold);
      EXPECT_GT(verdict.log_likelihood_ratio, 0.0);
      ++num_below;
    }
  }
  EXPECT_GT(num_below, 0);
}

// One that begins before the first is known learns for three seconds, as that does; a later one is
// not searched for three more.
TEST(LiveTrace, FramesOfAStationThatIsStillLearningAreNotSearched) {
  for (const auto& [other_from, unsearched] : {std::pair(20, 30), std::pair(40, 60)}) {
    Scene scene = With(DroneAt);
    scene.num_sensors = 2;
    scene.num_frames = 110;
    scene.other_from = other_from;
    scene.config.sensors["b"].translation_m = {0.0, -15.0, 0.0};  // a station of its own
    int count = 0;
    for (const Traced::Frame& frame : TraceOf(scene).frames) {
      if (frame.rejection == Rejection::kNone) continue;
      EXPECT_EQ(frame.rejection, Rejection::kWarmUp);
      EXPECT_EQ(frame.sensor, 1U);
      ++count;
    }
    EXPECT_NEAR(count, unsearched, 1) << other_from;
  }
}

TEST(LiveTrace, WhereDetectionsSurgeTheyAreNotSearchedUnlessThatIsDisabled) {
  Scene scene;
  scene.num_rain = 200;
  const auto num_surge = [&] {
    int count = 0;
    for (const Traced::Frame& frame : TraceOf(scene).frames) {
      count += frame.rejection == Rejection::kSurge ? 1 : 0;
    }
    return count;
  };
  const int num_of_one = num_surge();
  EXPECT_GE(num_of_one, 29);
  // Rain that comes back is known.
  scene.first_dry = 100;
  scene.last_dry = 220;
  scene.num_frames = 280;
  EXPECT_LE(num_surge(), num_of_one + 5);
  scene.config.robust.disabled_rules = {Rule::kSurge};
  EXPECT_EQ(num_surge(), 0);
}

TEST(LiveTrace, ReturnsOfPeopleAreBodies) {
  Scene scene = With([](int i) -> std::optional<Eigen::Vector3d> {
    return Eigen::Vector3d(-8.0 + 0.15 * i, 9.0, -1.0);
  });
  scene.num_returns = 60;
  std::size_t num_bodies = 0;
  for (const Traced::Frame& frame : TraceOf(scene).frames) num_bodies += frame.num_bodies;
  EXPECT_GT(num_bodies, 1000U);
}

TEST(LiveTrace, NumbersOfTracksGoOnWhereAStreamBeginsAnew) {
  Scene scene = With([](int i) { return DroneAt(i % 100); });
  scene.config.live.window_s = 5.0;
  scene.config.live.reorder_s = 0.0;
  Traced traced;
  LiveEngine engine(
      scene.config, {"a"}, FirstSensorStamps{}, [](const EngineEvent&) {}, nullptr, std::nullopt,
      false,
      [&](const LiveTraceEvent& event) {
        std::visit([&](const auto& one) { traced.Add(one); }, event);
      });
  Random random(12);
  for (int i = 0; i < 200; ++i) {
    CloudFrame frame;
    frame.stamp_ns = kBeginNs + (i + (i < 100 ? 0 : 1'000)) * kPeriodNs;
    frame.name = "frame";
    frame.cloud = CloudAt(scene, i, &random);
    engine.Add(std::move(frame));
  }
  engine.Close();
  std::set<int> numbers;
  for (const TracedTrack& track : traced.tracks) {
    if (track.state != TrackState::kInitiated) continue;
    EXPECT_TRUE(numbers.insert(track.number).second);
  }
  EXPECT_EQ(numbers.size(), 2U);
}

}  // namespace
}  // namespace unlidar
