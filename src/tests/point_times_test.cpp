// What ReadRecording() makes of a time field.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "base/maths.hpp"
#include "io/frames.hpp"
#include "tests/frame_folder.hpp"
#include "tests/pcd_writer.hpp"
#include "tests/read_recording.hpp"
#include "tests/temporary_folder.hpp"
#include "tests/times_of.hpp"

namespace unlidar {
namespace {

using testing::InputMessage;
using testing::kMs;
using testing::kUnix;
using testing::Read;
using testing::TemporaryFolder;
using testing::TestCloud;
using testing::TestEncoding;
using testing::TimedFrame;

// The same two frames of 0.1 s, their times written in each of the ways that drivers write them.
TEST(PointTimes, AreTheSameWhetherWrittenAsOffsetsOrAsUnixTimeInAnyUnit) {
  struct Writing {
    const char* what;
    double per_second;
    int size;
    char type;
    bool absolute;
  };
  const Writing writings[] = {
      {"offset ns u32", 1e9, 4, 'U', false}, {"offset ns u64", 1e9, 8, 'U', false},
      {"offset ns i32", 1e9, 4, 'I', false}, {"offset s f32", 1.0, 4, 'F', false},
      {"offset s f64", 1.0, 8, 'F', false},  {"unix s f64", 1.0, 8, 'F', true},
      {"unix ms f64", 1e3, 8, 'F', true},    {"unix us f64", 1e6, 8, 'F', true},
      {"unix ns f64", 1e9, 8, 'F', true},    {"unix ns u64", 1e9, 8, 'U', true},
      {"unix us u64", 1e6, 8, 'U', true},    {"unix ms i64", 1e3, 8, 'I', true}};
  SensorConfig sensor;
  sensor.time_offset_s = 0.25;
  for (const Writing& writing : writings) {
    SCOPED_TRACE(writing.what);
    const TemporaryFolder folder;
    for (const double stamp_s : {1706255621.0, 1706255621.1}) {
      std::vector<double> times;
      for (const double offset_s : {0.015625, 0.0, 0.09375}) {
        times.push_back(((writing.absolute ? stamp_s : 0.0) + offset_s) * writing.per_second);
      }
      std::string name = std::to_string(stamp_s);
      folder.Write(name + ".pcd", TimedFrame(times, writing.type, writing.size, "Timestamp"));
    }
    const Recording recording = Read(folder, {}, sensor);
    ASSERT_EQ(recording.times_ns.size(), 6U);
    const TimeNs begin_ns = kUnix + 250 * kMs;
    const TimeNs resolution_ns = writing.per_second == 1e3 ? kMs : 1000;
    for (std::size_t frame = 0; frame < 2; ++frame) {
      const TimeNs stamp_ns = begin_ns + static_cast<TimeNs>(frame) * 100 * kMs;
      EXPECT_EQ(recording.frames[frame].stamp_ns, stamp_ns);
      EXPECT_NEAR(static_cast<double>(recording.times_ns[3 * frame] - stamp_ns), 15'625'000.0,
                  static_cast<double>(resolution_ns));
      EXPECT_EQ(recording.frames[frame].begin_ns, recording.times_ns[3 * frame + 1]);
      EXPECT_EQ(recording.frames[frame].end_ns, recording.times_ns[3 * frame + 2]);
    }
  }
}

// Clocks that start at zero, as simulators have them: offset and time since start look alike in the
// first frame, and all frames of a sensor are read alike.
TEST(PointTimes, AreToldApartOnAClockThatStartsAtZero) {
  for (const bool absolute : {false, true}) {
    for (const char type : {'F', 'U'}) {
      const TemporaryFolder folder;
      for (int frame = 0; frame < 20; ++frame) {
        const double stamp_s = 0.0625 * frame;
        std::vector<double> times;
        for (const double offset_s : {0.0, 0.03125, 0.05}) {
          const double time_s = (absolute ? stamp_s : 0.0) + offset_s;
          times.push_back(type == 'F' ? time_s : std::round(time_s * 1e9));
        }
        folder.Write(std::to_string(stamp_s) + ".pcd", TimedFrame(times, type, 8));
      }
      const Recording recording = Read(folder);
      for (const FrameInfo& frame : recording.frames) {
        EXPECT_EQ(recording.times_ns[frame.first_return + 1], frame.stamp_ns + 31'250'000);
      }
    }
  }
}

TEST(PointTimes, FarFromTheStampAreRefusedWithFileAndValue) {
  const TemporaryFolder folder;
  folder.Write("1706255621.0.pcd", TimedFrame({0.0, 0.05}, 'F', 4));
  folder.Write("1706255621.1.pcd", TimedFrame({0.0, 1.5}, 'F', 4));
  const std::string message = InputMessage(folder);
  EXPECT_NE(message.find("1706255621.1.pcd: row 2 has the time 1.5"), std::string::npos) << message;

  const double nan = std::numeric_limits<double>::quiet_NaN();
  folder.Write("1706255621.1.pcd", TimedFrame({nan}, 'F', 8));
  EXPECT_NE(InputMessage(folder).find("row 1 has the time nan"), std::string::npos);
  folder.Write("1706255621.1.pcd", TimedFrame({1e300}, 'F', 8));
  EXPECT_NE(InputMessage(folder).find("row 1 has the time 1"), std::string::npos);

  InputConfig config;
  config.skip_bad_frames = true;
  EXPECT_EQ(Read(folder, config).counts.bad_frames, 1U);
}

TEST(PointTimes, OfSlowSensorsMayBeTenPeriodsAway) {
  const TemporaryFolder folder;
  folder.Write("1706255620.0.pcd", TimedFrame({0.0}, 'F', 4));
  folder.Write("1706255621.0.pcd", TimedFrame({9.5}, 'F', 4));
  EXPECT_EQ(Read(folder).times_ns[1], kUnix + 9'500 * kMs);
}

TEST(PointTimes, OfRowsWithoutAReturnNeedNotBeSound) {
  TestCloud cloud{{{"x"}, {"y"}, {"z"}, {"t", 'U', 4}}, {}};
  cloud.values = {{0, 0, 0, 4e9}, {0, 0, 0, 60e6}, {10, 0, 0, 20e6}};
  const TemporaryFolder folder;
  folder.Write("1706255621.0.pcd", Encoded(cloud, TestEncoding::kBinary));
  const Recording recording = Read(folder);
  EXPECT_EQ(testing::TimesOf(recording.times_ns), (std::vector<TimeNs>{kUnix + 20 * kMs}));
  EXPECT_EQ(recording.frames[0].begin_ns, kUnix + 20 * kMs);
  EXPECT_EQ(recording.frames[0].end_ns, kUnix + 60 * kMs);
}

// One turn of a single beam, from x over -y.
std::string TurnPcd() {
  constexpr int kReturns = 1000;
  std::vector<Eigen::Vector3f> rows;
  for (int i = 0; i < kReturns; ++i) {
    const double rad = -2.0 * M_PI * i / kReturns;
    rows.push_back(Eigen::Vector3d(10.0 * std::cos(rad), 10.0 * std::sin(rad), 0.0).cast<float>());
  }
  return BinaryPcd(rows);
}

TEST(PointTimes, OfALidarThatTurnsFollowFromTheOrderOfItsReturns) {
  const TemporaryFolder folder;
  for (const char* const stamp : {"1.0", "1.1", "1.2"}) {
    folder.Write(std::string(stamp) + ".pcd", TurnPcd());
  }
  SensorConfig sensor;
  sensor.translation_m = {100.0, 50.0, 3.0};  // the order is that of the sensor's own axes
  sensor.rotation_xyzw = {std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5)};
  const Recording recording = Read(folder, {}, sensor);
  for (const FrameInfo& frame : recording.frames) {
    EXPECT_TRUE(frame.is_timed);
    EXPECT_EQ(frame.begin_ns, frame.stamp_ns);
    EXPECT_EQ(frame.end_ns, frame.stamp_ns + 100 * kMs);
    for (std::uint32_t i = 0; i < 1000; i += 37) {
      const TimeNs time_ns = recording.times_ns[frame.first_return + i] - frame.begin_ns;
      EXPECT_NEAR(static_cast<double>(time_ns) / kMs, 100.0 * i / 999.0, 0.01);
    }
  }
}

// Every third frame of a LiDAR that turns ten times a second holds a turn, as does each of one that
// takes 0.3 s for it.
TEST(PointTimes, OfATurnThatMayLastUntilTheNextFrameOrLessAreHalfway) {
  const TemporaryFolder folder;
  for (const char* const stamp : {"1.0", "1.3", "1.6"}) {
    folder.Write(std::string(stamp) + ".pcd", TurnPcd());
  }
  const std::pair<StampMeaning, double> at_shares[] = {
      {StampMeaning::kBegin, 0.0}, {StampMeaning::kMiddle, 0.5}, {StampMeaning::kEnd, 1.0}};
  for (const auto& [stamp, at_share] : at_shares) {
    InputConfig config;
    config.stamp = stamp;
    const Recording recording = Read(folder, config);
    for (const FrameInfo& frame : recording.frames) {
      EXPECT_TRUE(frame.is_timed);
      double square_s2 = 0.0;
      for (std::uint32_t i = 0; i < 1000; ++i) {
        const double turned = i / 999.0 - at_share;
        const TimeNs time_ns = recording.times_ns[frame.first_return + i] - frame.stamp_ns;
        EXPECT_NEAR(SecondsOf(time_ns), 0.5 * (0.1 + 0.3) * turned, 1e-5);
        square_s2 += Square(SecondsOf(time_ns) - 0.3 * turned) / 1000.0;
      }
      EXPECT_NEAR(frame.time_sigma_s, std::sqrt(square_s2), 1e-4);
    }
  }
}

TEST(PointTimes, AreThoseOfTheMiddleWhereNoOrderTells) {
  const TemporaryFolder folder;
  for (const char* const stamp : {"1.0", "1.3", "1.6"}) {
    folder.Write(std::string(stamp) + ".pcd", BinaryPcd({{5, 0, 0}, {6, 0, 0}}));
  }
  const Recording recording = Read(folder);
  for (const FrameInfo& frame : recording.frames) {
    EXPECT_FALSE(frame.is_timed);
    EXPECT_EQ(frame.time_sigma_s, 0.0F);
    EXPECT_EQ(recording.times_ns[frame.first_return], frame.middle_ns());
  }
}

}  // namespace
}  // namespace unlidar
