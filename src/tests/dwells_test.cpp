#include "collection/dwells.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodS;
using testing::RecordingMaker;

constexpr int kGround = 1;
constexpr int kDrone = 2;
constexpr int kOther = 3;
constexpr double kClimb_s = 10.0;  // before it the drone hovers
constexpr int kFrames = 300;
constexpr double kGround_m = -1.5;
const Eigen::Vector3d kPad_m(8.0, 5.0, kGround_m + 0.8);

// Ground with a drone that hovers over its pad from `shown_s` on, and climbs away.
RecordingMaker TakeOff(const std::function<void(double time_s, RecordingMaker*)>& add,
                       double shown_s = 2.0, std::uint32_t seed = 1) {
  RecordingMaker maker(seed);
  for (int i = 0; i < kFrames; ++i) {
    const double time_s = (i + 0.5) * kPeriodS;
    maker.BeginFrame(i * kPeriodS);
    for (int k = 0; k < 60; ++k) {
      maker.Add(maker.random.InBox({4.0, 1.0, kGround_m - 0.05}, {12.0, 9.0, kGround_m + 0.05}),
                kGround);
    }
    add(time_s, &maker);
    if (time_s < shown_s) continue;
    const double up_m = 2.0 * std::max(0.0, time_s - kClimb_s);
    for (int k = 0; k < 2; ++k) {
      maker.Add(kPad_m + Eigen::Vector3d(0.0, 0.0, up_m) + maker.random.NormalVector(0.08), kDrone);
    }
  }
  return maker;
}

void Nothing(double /*time_s*/, RecordingMaker* /*maker*/) {}

// What a tracker would hand over: the drone from when it climbs.
std::vector<Plot> Climb(const RecordingMaker& maker) {
  std::vector<Plot> path;
  const Recording& recording = maker.recording;
  for (std::uint32_t f = 0; f < recording.frames.size(); ++f) {
    const FrameInfo& frame = recording.frames[f];
    Plot plot;
    plot.frame = f;
    plot.time_ns = plot.frame_time_ns = frame.middle_ns();
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      if (maker.labels[i] != kDrone) continue;
      plot.returns.push_back(i);
      plot.position_m += 0.5 * recording.points_m[i].cast<double>();
    }
    if (!plot.returns.empty() && plot.position_m.z() > kPad_m.z() + 0.5) path.push_back(plot);
  }
  return path;
}

struct Added {
  int num_drone = 0;
  int num_others = 0;
};

Added AddedTo(const RecordingMaker& maker, std::vector<char> taken = {}) {
  taken.resize(maker.labels.size(), 0);
  const std::vector<Plot> before = Climb(maker);
  std::vector<Plot> path = before;
  AddDwells(maker.recording, taken, &path);
  EXPECT_TRUE(std::is_sorted(path.begin(), path.end(), [](const Plot& a, const Plot& b) {
    return a.frame_time_ns < b.frame_time_ns;
  }));
  Added added;
  for (const Plot& plot : path) {
    const FrameInfo& frame = maker.recording.frames[plot.frame];
    for (const std::uint32_t i : plot.returns) {
      EXPECT_TRUE(frame.first_return <= i && i < frame.last_return);
      ++(maker.labels[i] == kDrone ? added.num_drone : added.num_others);
    }
  }
  for (const Plot& plot : before) added.num_drone -= static_cast<int>(plot.returns.size());
  return added;
}

// The same recording backwards: a landing.
RecordingMaker Reversed(const RecordingMaker& maker) {
  RecordingMaker reversed(1);
  const Recording& recording = maker.recording;
  for (std::size_t f = recording.frames.size(); f-- > 0;) {
    reversed.BeginFrame(static_cast<double>(kFrames - 1 - static_cast<int>(f)) * kPeriodS);
    const FrameInfo& frame = recording.frames[f];
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      reversed.Add(recording.points_m[i].cast<double>(), maker.labels[i]);
    }
  }
  return reversed;
}

TEST(Stays, BelongToTheFlightThatFollowsAndToTheOneBefore) {
  const RecordingMaker maker = TakeOff(Nothing);
  for (const RecordingMaker& each : {maker, Reversed(maker)}) {
    const Added added = AddedTo(each);
    EXPECT_GT(added.num_drone, 150);  // of 164 and what is within half a metre of the pad
    EXPECT_EQ(added.num_others, 0);
  }
}

TEST(Stays, EndWhereTheTargetIsHiddenForLong) {
  RecordingMaker maker = TakeOff(Nothing);
  Recording& recording = maker.recording;
  for (std::size_t i = 0; i < recording.points_m.size(); ++i) {
    const double time_s = testing::SecondsSinceBegin(recording.times_ns[i]);
    if (maker.labels[i] == kDrone && time_s > 4.0 && time_s < 7.5) {
      recording.points_m[i] = {50.0F, 0.0F, -1.0F};
    }
  }
  const Added added = AddedTo(maker);
  EXPECT_GT(added.num_drone, 40);
  EXPECT_LT(added.num_drone, 65);
}

TEST(Stays, AreNoneOfWhatIsThereAtOtherTimesAsWell) {
  // A twig, now and then.
  const RecordingMaker maker = TakeOff([](double, RecordingMaker* m) {
    if (m->random.Uniform(0.0, 1.0) < 0.3) m->Add(kPad_m + m->random.NormalVector(0.05), kOther);
  });
  const Added added = AddedTo(maker);
  EXPECT_EQ(added.num_drone + added.num_others, 0);
}

TEST(Stays, AreNoneOfRain) {
  for (std::uint32_t seed = 0; seed < 40; ++seed) {
    const RecordingMaker maker = TakeOff(
        [](double, RecordingMaker* m) {
          const Eigen::Vector3d size_m = Eigen::Vector3d::Constant(2.0);
          for (int k = m->random.Poisson(1.0); k > 0; --k) {
            m->Add(m->random.InBox(kPad_m - size_m, kPad_m + size_m), kOther);
          }
        },
        kClimb_s, seed);
    EXPECT_EQ(AddedTo(maker).num_others, 0) << seed;
  }
}

TEST(Stays, AreUnknownWhereTheTargetIsHardlyEverElsewhere) {
  RecordingMaker maker = TakeOff(Nothing);
  maker.recording.frames.resize(145);  // its climb takes three seconds to get away
  const Added added = AddedTo(maker);
  EXPECT_EQ(added.num_drone + added.num_others, 0);
}

TEST(Stays, AreNoneOfSomebodyWhoStoodThere) {
  const RecordingMaker maker = TakeOff(
      [](double time_s, RecordingMaker* m) {
        if (time_s > kClimb_s - 0.5) return;
        for (int k = 0; k < 2; ++k) {
          m->Add(kPad_m + m->random.InBox({-0.2, -0.2, -0.8}, {0.2, 0.2, 1.0}), kOther);
        }
      },
      kClimb_s);
  EXPECT_EQ(AddedTo(maker).num_others, 0);
}

TEST(Stays, TakeNothingFromOthers) {
  const RecordingMaker maker = TakeOff(Nothing);
  std::vector<char> taken(maker.labels.size(), 0);
  std::transform(maker.labels.begin(), maker.labels.end(), taken.begin(),
                 [](int label) { return label == kDrone ? 1 : 0; });
  EXPECT_EQ(AddedTo(maker, taken).num_drone, 0);
}

}  // namespace
}  // namespace unlidar
