#include "unlidar/engine.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "io/pcd.hpp"
#include "recording/pipeline.hpp"
#include "tests/draws.hpp"
#include "tests/synthetic_recording.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"
#include "unlidar/track_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::Random;

// Everything that an engine output.
struct EngineOutput {
  std::vector<TrajectoryRow> rows;
  std::vector<double> delays_s;  // of the rows that are not late
  std::vector<TrackPredicted> predicted;
  std::vector<TimeNs> predicted_at_ns;  // newest stamps then
  std::vector<TrackConfirmed> confirmed;
  std::vector<TrackEnded> ended;
  std::vector<EngineState> states;
  std::vector<SensorChanged> sensors;
};

// A wood about the station, ground below it, and a drone that flies over it from `begin_s` on.
class Scene {
 public:
  Scene(std::uint32_t seed, double drone_begin_s, double drone_end_s)
      : random_(seed), drone_begin_s_(drone_begin_s), drone_end_s_(drone_end_s) {
    for (int i = 0; i < 25; ++i) trees_m_.push_back(random_.InBox({-30, -30, 1}, {30, 30, 5}));
  }

  static Eigen::Vector3d DroneAt(double time_s) {
    return {-8.0 + 1.5 * time_s, 9.0, 11.0 + 0.1 * time_s};
  }

  Frame FrameAt(int i, std::uint32_t sensor = 0) {
    Frame frame;
    frame.sensor = sensor;
    frame.stamp_ns = kBeginNs + i * kPeriodNs;
    for (const Eigen::Vector3d& top_m : trees_m_) {
      const Eigen::Vector3d foot_m(top_m.x() - 0.8, top_m.y() - 0.8, -2.0);
      for (int k = 0; k < 20; ++k) {
        Add(random_.InBox(foot_m, top_m + Eigen::Vector3d(0.8, 0.8, 0.0)), &frame);
      }
    }
    for (int k = 0; k < 300; ++k) {
      const double range_m = random_.Uniform(2.0, 30.0);
      const double azimuth = random_.Uniform(-M_PI, M_PI);
      Add({range_m * std::cos(azimuth), range_m * std::sin(azimuth), -2.0 + random_.Normal(0.02)},
          &frame);
    }
    const double time_s = (i + 0.5) * kPeriodS;
    if (time_s >= drone_begin_s_ && time_s <= drone_end_s_) {
      for (int k = 0; k < 4; ++k) Add(DroneAt(time_s) + random_.NormalVector(0.1), &frame);
    }
    return frame;
  }

 private:
  static void Add(const Eigen::Vector3d& point_m, Frame* frame) {
    frame->points_m.push_back(point_m.cast<float>());
  }

  Random random_;
  double drone_begin_s_;
  double drone_end_s_;
  std::vector<Eigen::Vector3d> trees_m_;
};

EngineOutput EngineOutputOf(std::vector<Frame> frames, const Config& config = Config(),
                            const std::vector<std::string>& sensors = {"a"}) {
  EngineOutput output;
  Engine* asked = nullptr;
  Engine engine(config, sensors, [&](const EngineEvent& event) {
    if (const auto* row = std::get_if<RowGiven>(&event)) {
      output.rows.push_back(row->row);
      if (!row->is_late) {
        output.delays_s.push_back(static_cast<double>(asked->newest_ns() - row->row.time_ns) *
                                  1e-9);
      }
    }
    if (const auto* at = std::get_if<TrackPredicted>(&event)) {
      output.predicted.push_back(*at);
      output.predicted_at_ns.push_back(asked->newest_ns());
    }
    if (const auto* at = std::get_if<TrackConfirmed>(&event)) output.confirmed.push_back(*at);
    if (const auto* at = std::get_if<TrackEnded>(&event)) output.ended.push_back(*at);
    if (const auto* at = std::get_if<EngineState>(&event)) output.states.push_back(*at);
    if (const auto* at = std::get_if<SensorChanged>(&event)) output.sensors.push_back(*at);
  });
  asked = &engine;
  for (Frame& frame : frames) engine.Add(std::move(frame));
  engine.Close();
  return output;
}

std::vector<Frame> Frames(Scene scene, int count) {
  std::vector<Frame> frames;
  for (int i = 0; i < count; ++i) frames.push_back(scene.FrameAt(i));
  return frames;
}

bool AreSame(const std::vector<TrajectoryRow>& a, const std::vector<TrajectoryRow>& b) {
  return std::equal(
      a.begin(), a.end(), b.begin(), b.end(), [](const TrajectoryRow& x, const TrajectoryRow& y) {
        return x.time_ns == y.time_ns && x.track_id == y.track_id && x.position_m == y.position_m &&
               x.sigma_m == y.sigma_m && x.support == y.support;
      });
}

TEST(Engine, TellsOfADroneWithinItsDelayAndWhereItIs) {
  const EngineOutput output = EngineOutputOf(Frames(Scene(1, 6.0, 14.0), 280));
  ASSERT_EQ(output.confirmed.size(), 1U);
  EXPECT_NEAR(static_cast<double>(output.confirmed[0].first_evidence_ns - kBeginNs) * 1e-9, 6.0,
              0.6);
  ASSERT_EQ(output.ended.size(), 1U);
  EXPECT_NEAR(static_cast<double>(output.ended[0].last_evidence_ns - kBeginNs) * 1e-9, 14.0, 0.2);
  ASSERT_GT(output.rows.size(), 70U);
  ASSERT_GT(output.delays_s.size(), 50U);
  EXPECT_LE(*std::max_element(output.delays_s.begin(), output.delays_s.end()),
            Config().live.delay_s + kPeriodS + 1e-6);
  double square_m2 = 0.0;
  for (std::size_t i = 0; i < output.rows.size(); ++i) {
    const TrajectoryRow& row = output.rows[i];
    EXPECT_TRUE(i == 0 || output.rows[i - 1].time_ns < row.time_ns);
    // A stamp is the begin of its frame.
    const Eigen::Vector3d truth_m =
        Scene::DroneAt(static_cast<double>(row.time_ns - kBeginNs) * 1e-9);
    square_m2 += (row.position_m - truth_m).squaredNorm();
    EXPECT_LT((row.position_m - truth_m).norm(), 1.0);
    EXPECT_GT(row.sigma_m.minCoeff(), 0.0);
  }
  EXPECT_LT(std::sqrt(square_m2 / static_cast<double>(output.rows.size())), 0.2);
}

// Squared errors over their variances, summed over three axes, average 3.
TEST(Engine, PredictsAConfirmedTrackToTheStampOfEachFrameWithTrueSigmas) {
  double sum = 0.0;
  std::size_t count = 0;
  for (std::uint32_t seed = 1; seed <= testing::Draws(6U); ++seed) {
    const EngineOutput output = EngineOutputOf(Frames(Scene(seed, 4.0, 20.0), 200));
    ASSERT_EQ(output.confirmed.size(), 1U) << seed;
    ASSERT_GT(output.predicted.size(), 100U) << seed;
    for (std::size_t i = 0; i < output.predicted.size(); ++i) {
      const TrackPredicted& now = output.predicted[i];
      EXPECT_EQ(now.row.time_ns, output.predicted_at_ns[i]);
      EXPECT_EQ(now.row.track_id, output.confirmed[0].track_id);
      EXPECT_TRUE(i == 0 || now.row.time_ns == output.predicted[i - 1].row.time_ns + kPeriodNs);
      EXPECT_LT(now.unseen_s, 0.6);
      const Eigen::Vector3d truth_m =
          Scene::DroneAt(static_cast<double>(now.row.time_ns - kBeginNs) * 1e-9);
      sum += (now.row.position_m - truth_m).cwiseQuotient(now.row.sigma_m).squaredNorm();
      ++count;
    }
    EXPECT_EQ(output.predicted_at_ns.back(), kBeginNs + 199 * kPeriodNs);
  }
  EXPECT_GT(sum / static_cast<double>(count), 0.3);  // it flies straighter than the model expects
  EXPECT_LT(sum / static_cast<double>(count), 4.0);
}

// What lies behind a gap is unknown: sigmas grow until the track is seen again or ends.
TEST(Engine, APredictionIsTheLessSureTheLongerTheTrackIsUnseen) {
  const EngineOutput output = EngineOutputOf(Frames(Scene(1, 4.0, 14.0), 280));
  ASSERT_EQ(output.ended.size(), 1U);
  double before_m = 0.0;
  std::size_t unseen = 0;
  for (const TrackPredicted& now : output.predicted) {
    if (now.row.time_ns <= output.ended[0].last_evidence_ns + NsOf(0.6)) continue;
    EXPECT_NEAR(now.unseen_s,
                static_cast<double>(now.row.time_ns - output.ended[0].last_evidence_ns) * 1e-9,
                0.1);
    EXPECT_GT(now.row.sigma_m.norm(), before_m);
    before_m = now.row.sigma_m.norm();
    ++unseen;
  }
  EXPECT_GT(unseen, 80U);  // of the ten seconds until it is given up
  EXPECT_GT(before_m, 3.0);
}

// The scene is learned for three seconds, and then they are searched.
TEST(Engine, TellsOfADroneThatWasThereFromTheBegin) {
  const EngineOutput output = EngineOutputOf(Frames(Scene(1, 0.0, 14.0), 140));
  ASSERT_EQ(output.confirmed.size(), 1U);
  EXPECT_LT(output.confirmed[0].first_evidence_ns, kBeginNs + NsOf(0.3));
  EXPECT_LE(output.rows.front().time_ns, kBeginNs + kPeriodNs);
  EXPECT_GT(output.rows.size(), 135U);
}

// Warm-up: the scene is learned before detections are scored, and is searched from its begin then.
TEST(Engine, AFlightOfTheWarmUpHasAllItsRowsOnceTheSceneIsKnown) {
  for (const double height_m : {1.0, 6.0}) {
    constexpr int kTwoSeconds = 20;
    constexpr int kSixSeconds = 60;
    Random random(7);
    std::vector<Frame> frames = Frames(Scene(1, 1e9, 1e9), kSixSeconds);
    for (int i = 0; i < kSixSeconds; ++i) {
      const Eigen::Vector3d drone_m(-4.0 + 0.3 * i, 9.0, height_m);
      for (int k = 0; k < 4; ++k) {
        frames[static_cast<std::size_t>(i)].points_m.push_back(
            (drone_m + random.NormalVector(0.1)).cast<float>());
      }
    }
    const EngineOutput output = EngineOutputOf(frames);
    ASSERT_EQ(output.confirmed.size(), 1U) << height_m;
    ASSERT_GE(output.rows.size(), 58U);
    for (std::size_t i = 1; i < output.rows.size(); ++i) {
      EXPECT_EQ(output.rows[i].time_ns - output.rows[i - 1].time_ns, kPeriodNs);
    }
    frames.resize(kTwoSeconds);
    EXPECT_TRUE(EngineOutputOf(frames).confirmed.empty());
  }
}

// What was too little to be a track before a long pause is no part of what comes after it.
TEST(Engine, NoTrackReachesBackBeyondALongPause) {
  std::vector<Frame> frames = Frames(Scene(1, 6.0, 6.35), 90);
  const std::vector<Frame> later = Frames(Scene(1, 10.5, 16.0), 160);
  frames.insert(frames.end(), later.begin() + 90, later.end());
  const EngineOutput output = EngineOutputOf(std::move(frames));
  ASSERT_EQ(output.confirmed.size(), 1U);
  EXPECT_GT(output.confirmed[0].first_evidence_ns, kBeginNs + NsOf(10.4));
}

TEST(Engine, TellsOfNothingWhereNothingFlies) {
  for (std::uint32_t seed = 1; seed <= testing::Draws(3U); ++seed) {
    const EngineOutput output = EngineOutputOf(Frames(Scene(seed, 1e9, 1e9), 250));
    EXPECT_TRUE(output.confirmed.empty()) << seed;
    EXPECT_TRUE(output.rows.empty()) << seed;
    ASSERT_EQ(output.states.size(), 2U);
    EXPECT_EQ(output.states[0], EngineState::kWarmingUp);
    EXPECT_EQ(output.states[1], EngineState::kRunning);
  }
}

TEST(Engine, GivesTheSameRowsInWhateverOrderFramesComeThatAreNotTooLate) {
  const std::vector<Frame> frames = Frames(Scene(2, 5.0, 1e9), 160);
  const EngineOutput in_order = EngineOutputOf(frames);
  ASSERT_FALSE(in_order.rows.empty());
  std::vector<Frame> shuffled = frames;  // by 0.1 s: less than live.reorder_s
  for (std::size_t i = 10; i + 1 < shuffled.size(); i += 3) std::swap(shuffled[i], shuffled[i + 1]);
  EXPECT_TRUE(AreSame(EngineOutputOf(shuffled).rows, in_order.rows));
}

TEST(Engine, DropsAndCountsFramesThatComeTooLateAndRefusesRepeatedStamps) {
  Scene scene(3, 1e9, 1e9);
  Engine engine(Config(), {"a"}, [](const EngineEvent&) {});
  for (int i = 0; i < 20; ++i) engine.Add(scene.FrameAt(i));
  engine.Add(scene.FrameAt(3));
  EXPECT_EQ(engine.late_frames(), 1U);
  EXPECT_EQ(engine.counts().frames, 20U);
  EXPECT_THROW(engine.Add(scene.FrameAt(19)), InputError);
  engine.Add(scene.FrameAt(20));  // goes on
  EXPECT_EQ(engine.counts().frames, 21U);
  engine.Close();
}

// Frames 0 to `count` with the drone all the time, of which those from `from` to `to` have other
// stamps.
std::vector<Frame> Jumping(int count, int from, int to, TimeNs by_ns) {
  std::vector<Frame> frames = Frames(Scene(12, 5.0, 1e9), count);
  for (int i = from; i < to; ++i) frames[static_cast<std::size_t>(i)].stamp_ns += by_ns;
  return frames;
}

constexpr TimeNs kHourNs = 3600 * TimeNs{1'000'000'000};

TEST(Engine, AClockThatGoesBackIsANewBeginning) {
  const std::vector<Frame> frames = Jumping(300, 150, 300, -kHourNs);
  const EngineOutput output = EngineOutputOf(frames);
  using State = EngineState;
  EXPECT_EQ(output.states, (std::vector<State>{State::kWarmingUp, State::kRunning,
                                               State::kWarmingUp, State::kRunning}));
  ASSERT_EQ(output.confirmed.size(), 2U);
  EXPECT_EQ(output.confirmed[1].track_id, 1);
  EXPECT_EQ(output.ended.size(), 2U);
  // Before it and after it the rows are those of two engines.
  std::vector<TrajectoryRow> rows = EngineOutputOf({frames.begin(), frames.begin() + 150}).rows;
  ASSERT_GT(rows.size(), 50U);
  for (TrajectoryRow row : EngineOutputOf({frames.begin() + 150, frames.end()}).rows) {
    row.track_id = 1;
    rows.push_back(row);
  }
  EXPECT_GT(rows.size(), 150U);
  EXPECT_TRUE(AreSame(output.rows, rows));
}

TEST(Engine, APauseLongerThanAllThatItRemembersIsANewBeginning) {
  const std::vector<Frame> frames = Jumping(300, 150, 300, kHourNs);
  const EngineOutput output = EngineOutputOf(frames);
  EXPECT_EQ(output.states.size(), 4U);
  std::vector<TrajectoryRow> rows = EngineOutputOf({frames.begin(), frames.begin() + 150}).rows;
  for (TrajectoryRow row : EngineOutputOf({frames.begin() + 150, frames.end()}).rows) {
    row.track_id = 1;
    rows.push_back(row);
  }
  EXPECT_GT(rows.size(), 150U);
  EXPECT_TRUE(AreSame(output.rows, rows));
  // A shorter one is none.
  const TimeNs shorter_ns = static_cast<TimeNs>((Config().live.window_s - 1.0) * 1e9);
  EXPECT_EQ(EngineOutputOf(Jumping(300, 150, 300, shorter_ns)).states.size(), 2U);
}

TEST(Engine, OneStampOfTheFarFutureBlindsNobody) {
  const EngineOutput output = EngineOutputOf(Jumping(300, 150, 151, 500'000 * kHourNs));
  ASSERT_GT(output.rows.size(), 150U);
  EXPECT_LT(output.rows.back().time_ns, kBeginNs + 300 * kPeriodNs);
  EXPECT_GT(output.rows.back().time_ns, kBeginNs + 295 * kPeriodNs);
}

TEST(Engine, APauseOfSensorsLosesNoFrameAndFramesThatWaitAreCounted) {
  Scene scene(12, 1e9, 1e9);
  Engine engine(Config(), {"a", "b"}, [](const EngineEvent&) {});
  for (int i = 0; i < 100; ++i) {
    for (const std::uint32_t sensor : {0U, 1U}) {
      Frame frame = scene.FrameAt(i, sensor);
      if (i >= 50) frame.stamp_ns += kHourNs / 180;
      engine.Add(std::move(frame));
    }
  }
  EXPECT_EQ(engine.counts().frames, 200U);
  Frame stray = scene.FrameAt(100);
  stray.stamp_ns += kHourNs;
  engine.Add(stray);
  EXPECT_THROW(engine.Add(stray), InputError);  // the same again
  EXPECT_EQ(engine.astray_frames(), 0U);
  engine.Close();
  EXPECT_EQ(engine.astray_frames(), 1U);
  EXPECT_EQ(engine.late_frames(), 0U);
  EXPECT_EQ(engine.counts().frames, 200U);
}

TEST(Engine, ASensorFarBehindTheOthersIsLateAndEndsNothing) {
  const std::vector<Frame> alone = Frames(Scene(12, 5.0, 1e9), 200);
  std::vector<Frame> frames;
  for (const Frame& frame : alone) {
    frames.push_back(frame);
    frames.push_back(frame);
    frames.back().sensor = 1;
    frames.back().stamp_ns -= kHourNs;
  }
  const EngineOutput output = EngineOutputOf(std::move(frames), Config(), {"a", "b"});
  EXPECT_EQ(output.states.size(), 2U);
  EXPECT_TRUE(AreSame(output.rows, EngineOutputOf(alone).rows));
}

TEST(Engine, ADroneThatHoversForLongerThanTheWindowStaysOneTrack) {
  Scene scene(4, 1e9, 1e9);
  Random random(4);
  Config config;
  config.live.window_s = 20.0;
  std::vector<Frame> frames;
  for (int i = 0; i < 420; ++i) {
    frames.push_back(scene.FrameAt(i));
    const double time_s = (i + 0.5) * kPeriodS;
    if (time_s < 6.0) continue;
    // Comes for five seconds, then wanders about one place.
    const double along_m = std::min(time_s - 6.0, 5.0) * 2.0;
    const Eigen::Vector3d at_m(-5.0 + along_m + 0.1 * std::sin(0.5 * time_s), 8.0,
                               12.0 + 0.1 * std::cos(0.3 * time_s));
    for (int k = 0; k < 4; ++k) {
      frames.back().points_m.push_back((at_m + random.NormalVector(0.1)).cast<float>());
    }
  }
  const EngineOutput output = EngineOutputOf(std::move(frames), config);
  ASSERT_EQ(output.confirmed.size(), 1U);
  EXPECT_GT(output.rows.size(), 320U);
  EXPECT_GT(static_cast<double>(output.rows.back().time_ns - kBeginNs) * 1e-9, 40.0);
}

TEST(Engine, TellsWhenASensorIsSilentAndWhenItIsBack) {
  Scene scene(5, 1e9, 1e9);
  std::vector<Frame> frames;
  for (int i = 0; i < 120; ++i) {
    frames.push_back(scene.FrameAt(i, 0));
    if (i < 40 || i > 80) {
      frames.push_back(scene.FrameAt(i, 1));
      frames.back().stamp_ns += kPeriodNs / 3;
    }
  }
  const EngineOutput output = EngineOutputOf(std::move(frames), Config(), {"a", "b"});
  std::vector<SensorState> states;
  for (const SensorChanged& change : output.sensors) {
    if (change.sensor == 1) states.push_back(change.state);
  }
  EXPECT_EQ(states,
            (std::vector<SensorState>{SensorState::kOk, SensorState::kSilent, SensorState::kOk}));
}

// Frames with so many returns of fog more: ranges gamma distributed with a mean of 5 m.
void AddFog(int returns, std::uint32_t seed, std::vector<Frame>* frames) {
  Random random(seed);
  for (Frame& frame : *frames) {
    for (int k = 0; k < returns; ++k) {
      const Eigen::Vector3d ray = random.NormalVector(1.0).normalized();
      const double range_m = -2.5 * std::log(random.Uniform(0.0, 1.0) * random.Uniform(0.0, 1.0));
      frame.points_m.emplace_back((range_m * ray).cast<float>());
    }
  }
}

TEST(Engine, InThickFogItTellsThatItIsBlindedAndOfNoDroneThatIsNotThere) {
  for (std::uint32_t seed = 1; seed <= testing::Draws(2U); ++seed) {
    std::vector<Frame> frames = Frames(Scene(seed, 1e9, 1e9), 100);
    AddFog(1500, seed, &frames);
    const EngineOutput output = EngineOutputOf(frames);
    EXPECT_TRUE(output.confirmed.empty()) << seed;
    ASSERT_EQ(output.sensors.size(), 2U) << seed;
    EXPECT_EQ(output.sensors[0].state, SensorState::kOk);
    EXPECT_EQ(output.sensors[1].state, SensorState::kBlinded);
  }
}

// What was open air a moment ago says nothing of the snow in it.
TEST(Engine, SnowThatComesIsNoSwarmOfDrones) {
  std::vector<Frame> frames = Frames(Scene(4, 1e9, 1e9), 180);
  Random random(1);
  for (int i = 90; i < 180; ++i) {
    for (int k = 0; k < 150; ++k) {
      const Eigen::Vector3d ray = random.NormalVector(1.0).normalized();
      const Eigen::Vector3d up(ray.x(), ray.y(), std::abs(ray.z()));
      const Eigen::Vector3f flake_m = (random.Uniform(1.0, 30.0) * up).cast<float>();
      frames[static_cast<std::size_t>(i)].points_m.push_back(flake_m);
    }
  }
  EXPECT_EQ(EngineOutputOf(frames).confirmed.size(), 0U);
}

TEST(Engine, AWindowThatIsCoveredForAWhileBlindsOneSensorForThatWhile) {
  Scene scene(5, 1e9, 1e9);
  std::vector<Frame> frames;
  for (int i = 0; i < 300; ++i) {
    frames.push_back(scene.FrameAt(i, 0));
    frames.push_back(scene.FrameAt(i, 1));
    frames.back().stamp_ns += kPeriodNs / 3;
    if (i >= 100 && i < 200) frames.back().points_m.clear();
  }
  const EngineOutput output = EngineOutputOf(std::move(frames), Config(), {"a", "b"});
  ASSERT_EQ(output.sensors.size(), 4U);
  EXPECT_EQ(output.sensors[2].sensor, 1U);
  EXPECT_EQ(output.sensors[2].state, SensorState::kBlinded);
  EXPECT_EQ(output.sensors[3].sensor, 1U);
  EXPECT_EQ(output.sensors[3].state, SensorState::kOk);
}

TEST(Engine, TellsTheSameWhereverItsSensorStands) {
  const Eigen::Vector3d by_m(256.0, -512.0, 16.0);
  Config moved;
  moved.sensors["a"].translation_m = by_m;
  const std::vector<Frame> frames = Frames(Scene(1, 6.0, 14.0), 200);
  const EngineOutput at_origin = EngineOutputOf(frames);
  const EngineOutput elsewhere = EngineOutputOf(frames, moved);
  ASSERT_EQ(elsewhere.confirmed.size(), 1U);
  ASSERT_EQ(elsewhere.rows.size(), at_origin.rows.size());
  for (std::size_t i = 0; i < elsewhere.rows.size(); ++i) {
    const TrajectoryRow& a = at_origin.rows[i];
    const TrajectoryRow& b = elsewhere.rows[i];
    EXPECT_EQ(b.time_ns, a.time_ns);
    EXPECT_LT((b.position_m - by_m - a.position_m).norm(), 0.01) << i;
    EXPECT_LT((b.sigma_m - a.sigma_m).norm(), 0.01) << i;
  }
}

TEST(Engine, AStationThatIsHeardLaterLearnsWhatIsAboutItAndFindsItsDrone) {
  const Eigen::Vector3d by_m(300.0, 40.0, 3.0);
  Config config;
  config.sensors["b"].translation_m = by_m;
  Scene about_a(1, 1e9, 1e9);
  Scene about_b(2, 20.0, 28.0);
  std::vector<Frame> frames;
  for (int i = 0; i < 320; ++i) {
    frames.push_back(about_a.FrameAt(i, 0));
    if (i >= 80) frames.push_back(about_b.FrameAt(i, 1));
  }
  const EngineOutput output = EngineOutputOf(frames, config, {"a", "b"});
  ASSERT_EQ(output.confirmed.size(), 1U);
  EXPECT_NEAR(static_cast<double>(output.confirmed[0].first_evidence_ns - kBeginNs) * 1e-9, 20.0,
              0.6);
  ASSERT_GT(output.rows.size(), 70U);
  for (const TrajectoryRow& row : output.rows) {
    const Eigen::Vector3d truth_m =
        by_m + Scene::DroneAt(static_cast<double>(row.time_ns - kBeginNs) * 1e-9);
    EXPECT_LT((row.position_m - truth_m).norm(), 0.5);
  }
}

TEST(Engine, APauseOfAllSensorsMakesNoNewScene) {
  Scene scene(6, 1e9, 1e9);
  std::vector<Frame> frames;
  for (int i = 0; i < 300; ++i) {
    frames.push_back(scene.FrameAt(i));
    if (i >= 150) frames.back().stamp_ns += 3600 * TimeNs{1'000'000'000};
  }
  EXPECT_TRUE(EngineOutputOf(std::move(frames)).confirmed.empty());
}

TEST(Engine, AdvanceGivesWhatIsDueTellsOfSilenceAndEndsWhatMayComeLate) {
  Scene scene(7, 4.0, 1e9);
  EngineOutput output;
  TimeNs last_row_ns = 0;
  Engine engine(Config(), {"a"}, [&](const EngineEvent& event) {
    if (const auto* row = std::get_if<RowGiven>(&event)) last_row_ns = row->row.time_ns;
    if (const auto* at = std::get_if<SensorChanged>(&event)) output.sensors.push_back(*at);
  });
  engine.Advance(kBeginNs);  // nothing has begun
  EXPECT_EQ(engine.newest_ns(), 0);
  for (int i = 0; i < 120; ++i) engine.Add(scene.FrameAt(i));
  const TimeNs end_ns = kBeginNs + 119 * kPeriodNs;
  ASSERT_GT(last_row_ns, 0);
  EXPECT_LT(last_row_ns, end_ns - 5 * kPeriodNs);
  const double silent_s = Config().live.silent_s;
  engine.Advance(end_ns + static_cast<TimeNs>((silent_s - 0.1) * 1e9));
  EXPECT_EQ(last_row_ns, end_ns);
  EXPECT_EQ(output.sensors.size(), 1U);
  engine.Advance(end_ns + static_cast<TimeNs>((silent_s + 0.1) * 1e9));
  ASSERT_EQ(output.sensors.size(), 2U);
  EXPECT_EQ(output.sensors.back().state, SensorState::kSilent);
  engine.Advance(end_ns);  // time does not run back
  EXPECT_EQ(engine.newest_ns(), end_ns + static_cast<TimeNs>((silent_s + 0.1) * 1e9));
  engine.Add(scene.FrameAt(120));
  EXPECT_EQ(engine.late_frames(), 1U);
  engine.Add(scene.FrameAt(150));
  ASSERT_EQ(output.sensors.size(), 3U);
  EXPECT_EQ(output.sensors.back().state, SensorState::kOk);
  engine.Close();
}

TEST(Engine, WithAnEndlessDelayAdvanceChangesNoRow) {
  const std::vector<Frame> frames = Frames(Scene(8, 4.0, 12.0), 160);
  Config endless;
  endless.live.delay_s = std::numeric_limits<double>::infinity();
  const EngineOutput alone = EngineOutputOf(frames, endless);
  ASSERT_FALSE(alone.rows.empty());
  std::vector<TrajectoryRow> rows;
  Engine engine(endless, {"a"}, [&](const EngineEvent& event) {
    if (const auto* row = std::get_if<RowGiven>(&event)) rows.push_back(row->row);
  });
  for (const Frame& frame : frames) {
    engine.Add(frame);
    engine.Advance(frame.stamp_ns + 10 * kPeriodNs);
  }
  engine.Close();
  EXPECT_TRUE(AreSame(rows, alone.rows));
}

TEST(Engine, PointTimesAreOffsetsWhateverTheStampsAreLike) {
  // Half a frame period as a time since 1970 is nearer to these stamps than as an offset.
  std::vector<Frame> frames = Frames(Scene(9, 1e9, 1e9), 50);
  for (Frame& frame : frames) {
    frame.stamp_ns -= kBeginNs - kPeriodNs / 100;
    frame.offsets_ns.assign(frame.points_m.size(), kPeriodNs / 2);
  }
  EXPECT_NO_THROW(EngineOutputOf(frames));
  EXPECT_NO_THROW(TrackRecording(Config(), {"a"}, frames));
}

TEST(Engine, RefusesWhatNoFrameAndNoRateCanBeAndGoesOn) {
  Scene scene(10, 1e9, 1e9);
  Engine engine(Config(), {"a"}, [](const EngineEvent&) {});
  EXPECT_THROW(engine.Add(scene.FrameAt(0, 1)), InputError);
  Frame frame = scene.FrameAt(0);
  frame.offsets_ns = {0};
  EXPECT_THROW(engine.Add(frame), InputError);
  engine.Add(scene.FrameAt(0));
  EXPECT_EQ(engine.counts().frames, 1U);
  EXPECT_EQ(engine.AddSensor("b"), 1U);
  engine.Add(scene.FrameAt(1, 1));
  EXPECT_EQ(engine.counts().frames, 2U);
  for (const std::int64_t nanohertz : {std::int64_t{0}, std::int64_t{1'000'000'000'000'001}}) {
    EXPECT_THROW(Engine(
                     Config(), {"a"}, [](const EngineEvent&) {}, Rate{nanohertz}),
                 UsageError);
  }
  Config paper;
  paper.method = Method::kPaper;
  EXPECT_THROW(Engine(paper, {"a"}, [](const EngineEvent&) {}), ConfigError);
}

TEST(TrackRecording, GivesTheRowsThatTheProgramWritesOfTheSameFrames) {
  const std::vector<Frame> frames = Frames(Scene(11, 3.0, 9.0), 120);
  const testing::TemporaryFolder folder;
  for (const Frame& frame : frames) {
    folder.Write(std::to_string(frame.stamp_ns) + ".pcd", BinaryPcd(frame.points_m));
  }
  PipelineRequest request;
  request.sources = {{"a", folder.path()}};
  request.output_times = Rate{25'000'000'000};
  const PipelineResult written =
      RunPipeline(request, Config(), [](const StageTime&, const std::string&) {});

  std::vector<Frame> shuffled = frames;
  std::reverse(shuffled.begin(), shuffled.end());
  const std::vector<Track> tracks = TrackRecording(Config(), {"a"}, shuffled, request.output_times);
  ASSERT_EQ(tracks.size(), 1U);
  ASSERT_EQ(written.tracks.size(), 1U);
  EXPECT_EQ(tracks[0].begin_ns, written.tracks[0].begin_ns());
  EXPECT_EQ(tracks[0].end_ns, written.tracks[0].end_ns());
  std::vector<TrajectoryRow> rows;
  const RowStream next = RowsOf(written, written.tracks[0]);
  while (const std::optional<TrajectoryRow> row = next()) rows.push_back(*row);
  EXPECT_GT(rows.size(), 100U);
  EXPECT_TRUE(AreSame(tracks[0].rows, rows));
  // Instants out of order, and twice, give each row once.
  std::vector<TimeNs> instants;
  for (const TrajectoryRow& row : rows) instants.insert(instants.begin(), 2, row.time_ns);
  EXPECT_EQ(TrackRecording(Config(), {"a"}, frames, instants)[0].rows.size(), rows.size());
}

}  // namespace
}  // namespace unlidar
