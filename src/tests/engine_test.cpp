#include "live/engine.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "tests/synthetic_recording.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::Random;

// Everything that an engine told.
struct Told {
  std::vector<TrajectoryRow> rows;
  std::vector<double> delays_s;  // of the rows that are not late
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
    frame.name = "frame " + std::to_string(i);
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
    frame->cloud.points_m.push_back(point_m.cast<float>());
  }

  Random random_;
  double drone_begin_s_;
  double drone_end_s_;
  std::vector<Eigen::Vector3d> trees_m_;
};

Told Track(std::vector<Frame> frames, const Config& config = Config(),
           const std::vector<std::string>& sensors = {"a"}) {
  Told told;
  Engine* asked = nullptr;
  Engine engine(config, sensors, FirstSensorStamps{}, [&](const EngineEvent& event) {
    if (const auto* row = std::get_if<RowGiven>(&event)) {
      told.rows.push_back(row->row);
      if (!row->is_late) {
        told.delays_s.push_back(static_cast<double>(asked->newest_ns() - row->row.time_ns) * 1e-9);
      }
    }
    if (const auto* at = std::get_if<TrackConfirmed>(&event)) told.confirmed.push_back(*at);
    if (const auto* at = std::get_if<TrackEnded>(&event)) told.ended.push_back(*at);
    if (const auto* at = std::get_if<EngineState>(&event)) told.states.push_back(*at);
    if (const auto* at = std::get_if<SensorChanged>(&event)) told.sensors.push_back(*at);
  });
  asked = &engine;
  for (Frame& frame : frames) engine.Add(std::move(frame));
  engine.Close();
  return told;
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
  const Told told = Track(Frames(Scene(1, 6.0, 14.0), 280));
  ASSERT_EQ(told.confirmed.size(), 1U);
  EXPECT_NEAR(static_cast<double>(told.confirmed[0].first_evidence_ns - kBeginNs) * 1e-9, 6.0, 0.6);
  ASSERT_EQ(told.ended.size(), 1U);
  EXPECT_NEAR(static_cast<double>(told.ended[0].last_evidence_ns - kBeginNs) * 1e-9, 14.0, 0.2);
  ASSERT_GT(told.rows.size(), 70U);
  ASSERT_GT(told.delays_s.size(), 50U);
  EXPECT_LE(*std::max_element(told.delays_s.begin(), told.delays_s.end()),
            Config().live.delay_s + kPeriodS + 1e-6);
  double square_m2 = 0.0;
  for (std::size_t i = 0; i < told.rows.size(); ++i) {
    const TrajectoryRow& row = told.rows[i];
    EXPECT_TRUE(i == 0 || told.rows[i - 1].time_ns < row.time_ns);
    // A stamp is the begin of its frame.
    const Eigen::Vector3d truth_m =
        Scene::DroneAt(static_cast<double>(row.time_ns - kBeginNs) * 1e-9);
    square_m2 += (row.position_m - truth_m).squaredNorm();
    EXPECT_LT((row.position_m - truth_m).norm(), 1.0);
    EXPECT_GT(row.sigma_m.minCoeff(), 0.0);
  }
  EXPECT_LT(std::sqrt(square_m2 / static_cast<double>(told.rows.size())), 0.2);
}

TEST(Engine, TellsOfNothingWhereNothingFlies) {
  for (std::uint32_t seed = 1; seed <= 3; ++seed) {
    const Told told = Track(Frames(Scene(seed, 1e9, 1e9), 250));
    EXPECT_TRUE(told.confirmed.empty()) << seed;
    EXPECT_TRUE(told.rows.empty()) << seed;
    ASSERT_EQ(told.states.size(), 2U);
    EXPECT_EQ(told.states[0], EngineState::kWarmingUp);
    EXPECT_EQ(told.states[1], EngineState::kRunning);
  }
}

TEST(Engine, GivesTheSameRowsInWhateverOrderFramesComeThatAreNotTooLate) {
  const std::vector<Frame> frames = Frames(Scene(2, 5.0, 1e9), 160);
  const Told in_order = Track(frames);
  ASSERT_FALSE(in_order.rows.empty());
  std::vector<Frame> shuffled = frames;  // by 0.1 s: less than live.reorder_s
  for (std::size_t i = 10; i + 1 < shuffled.size(); i += 3) std::swap(shuffled[i], shuffled[i + 1]);
  EXPECT_TRUE(AreSame(Track(shuffled).rows, in_order.rows));
}

TEST(Engine, DropsAndCountsFramesThatComeTooLateAndRefusesRepeatedStamps) {
  Scene scene(3, 1e9, 1e9);
  Engine engine(Config(), {"a"}, FirstSensorStamps{}, [](const EngineEvent&) {});
  for (int i = 0; i < 20; ++i) engine.Add(scene.FrameAt(i));
  engine.Add(scene.FrameAt(3));
  EXPECT_EQ(engine.late_frames(), 1U);
  EXPECT_EQ(engine.counts().frames, 20U);
  EXPECT_THROW(engine.Add(scene.FrameAt(19)), InputError);
  engine.Add(scene.FrameAt(20));  // goes on
  EXPECT_EQ(engine.counts().frames, 21U);
  engine.Close();
}

TEST(Engine, ADroneThatHoversForLongerThanTheWindowStaysOneTrack) {
  Scene scene(4, 1e9, 1e9);
  Random random(4);
  std::vector<Frame> frames;
  for (int i = 0; i < 900; ++i) {
    frames.push_back(scene.FrameAt(i));
    const double time_s = (i + 0.5) * kPeriodS;
    if (time_s < 6.0) continue;
    // Comes for five seconds, then wanders about one place.
    const double along_m = std::min(time_s - 6.0, 5.0) * 2.0;
    const Eigen::Vector3d at_m(-5.0 + along_m + 0.1 * std::sin(0.5 * time_s), 8.0,
                               12.0 + 0.1 * std::cos(0.3 * time_s));
    for (int k = 0; k < 4; ++k) {
      frames.back().cloud.points_m.push_back((at_m + random.NormalVector(0.1)).cast<float>());
    }
  }
  const Told told = Track(std::move(frames));
  ASSERT_EQ(told.confirmed.size(), 1U);
  EXPECT_GT(told.rows.size(), 800U);
  EXPECT_GT(static_cast<double>(told.rows.back().time_ns - kBeginNs) * 1e-9, 88.0);
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
  const Told told = Track(std::move(frames), Config(), {"a", "b"});
  std::vector<bool> is_silent;
  for (const SensorChanged& change : told.sensors) {
    if (change.sensor == 1) is_silent.push_back(change.is_silent);
  }
  EXPECT_EQ(is_silent, (std::vector<bool>{false, true, false}));
}

TEST(Engine, APauseOfAllSensorsMakesNoNewScene) {
  Scene scene(6, 1e9, 1e9);
  std::vector<Frame> frames;
  for (int i = 0; i < 300; ++i) {
    frames.push_back(scene.FrameAt(i));
    if (i >= 150) frames.back().stamp_ns += 3600 * TimeNs{1'000'000'000};
  }
  EXPECT_TRUE(Track(std::move(frames)).confirmed.empty());
}

}  // namespace
}  // namespace unlidar
