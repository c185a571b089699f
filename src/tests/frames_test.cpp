#include "io/frames.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <vector>

#include "io/pcd.hpp"
#include "tests/frame_folder.hpp"
#include "tests/read_recording.hpp"
#include "tests/several_threads.hpp"
#include "tests/temporary_folder.hpp"
#include "tests/times_of.hpp"
#include "tests/without_privileges.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using testing::InputMessage;
using testing::kMs;
using testing::kSecond;
using testing::kUnix;
using testing::OnePoint;
using testing::Read;
using testing::TemporaryFolder;
using testing::TimedFrame;
using testing::WithoutPrivileges;

std::vector<TimeNs> Stamps(const Recording& recording) {
  std::vector<TimeNs> stamps;
  for (const FrameInfo& frame : recording.frames) stamps.push_back(frame.stamp_ns);
  return stamps;
}

TEST(FrameStamps, OrderIsThatOfTheNumbersAndExactToTheNanosecond) {
  const TemporaryFolder folder;
  folder.Write("10.000000001.pcd", OnePoint());
  folder.Write("9.5.pcd", OnePoint());
  folder.Write("100.25.pcd", OnePoint());
  folder.Write("1706255621614239001.pcd", OnePoint());
  EXPECT_EQ(Stamps(Read(folder)), (std::vector<TimeNs>{9'500 * kMs, 10 * kSecond + 1, 100'250 * kMs,
                                                       1'706'255'621'614'239'001}));
}

TEST(FrameStamps, OnlyPcdFilesThatAreNotHiddenAreFrames) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", OnePoint());
  for (const char* other : {"._2.0.pcd", "notes.txt", "3.0.pcd.bak", "4.0.npy", ".pcd"}) {
    folder.Write(other, "no frame");
  }
  folder.Write("5.0.pcd/file", "a folder");
  EXPECT_EQ(Read(folder).frames.size(), 1U);
}

TEST(FrameStamps, ATableOverridesTheNames) {
  const TemporaryFolder folder;
  folder.Write("b.pcd", OnePoint());
  folder.Write("1.0.pcd", OnePoint());
  folder.Write("timestamps.csv", "file,timestamp\r\nb.pcd,12.000000001\r\n\r\n1.0.pcd , 13\r\n");
  EXPECT_EQ(Stamps(Read(folder)), (std::vector<TimeNs>{12 * kSecond + 1, 13 * kSecond}));
}

TEST(FrameStamps, ATableWithAWrongLineIsRefusedWithItsNumber) {
  const std::string header = "file,timestamp\n";
  const std::pair<std::string, std::string> expected_by_table[] = {
      {"", "is empty"},
      {"name,time\n", "timestamps.csv:1: the header is 'name,time'"},
      {header + "1.0.pcd\n", "timestamps.csv:2: '1.0.pcd' has one value"},
      {header + "1.0.pcd,soon\n", "timestamps.csv:2: the timestamp is 'soon'"},
      {header + "1.0.pcd,99999999999\n", "timestamps.csv:2: the timestamp is '99999999999'"},
      {header + "1.0.pcd,1\n\n3.0.pcd,2\n", "timestamps.csv:4: '3.0.pcd' is no frame"},
      {header + "1.0.pcd,1\n1.0.pcd,2\n", "timestamps.csv:3: '1.0.pcd' is listed a second time"},
      {header + "1.0.pcd,1\n", "timestamps.csv:2: the last line, and no stamp for '2.0.pcd'"}};
  for (const auto& [table, expected] : expected_by_table) {
    const TemporaryFolder folder;
    folder.Write("1.0.pcd", OnePoint());
    folder.Write("2.0.pcd", OnePoint());
    folder.Write("timestamps.csv", table);
    EXPECT_NE(InputMessage(folder).find(expected), std::string::npos)
        << InputMessage(folder) << " | " << expected;
  }
}

TEST(FrameStamps, TwoFramesOfOneSensorWithOneStampAreRefused) {
  const TemporaryFolder folder;
  folder.Write("01.6.pcd", OnePoint());
  folder.Write("1.5.pcd", OnePoint());
  folder.Write("1.6.pcd", OnePoint());
  const std::string message = InputMessage(folder);
  EXPECT_NE(message.find("/01.6.pcd"), std::string::npos) << message;
  EXPECT_NE(message.find("/1.6.pcd"), std::string::npos) << message;
}

TEST(FrameStamps, AFileWithoutAStampIsRefused) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", OnePoint());
  folder.Write("map.pcd", OnePoint());
  InputConfig config;
  config.skip_bad_frames = true;
  EXPECT_NE(InputMessage(folder, config).find("'map' is no stamp"), std::string::npos);
}

TEST(FrameDirectories, MissingAndEmptyOnesAreRefused) {
  const TemporaryFolder folder;
  folder.Write("notes.txt", "");
  EXPECT_NE(InputMessage(folder).find("no .pcd file"), std::string::npos);
  EXPECT_THROW(ReadRecording({{"", folder / "missing"}}, {}, {}), InputError);
  EXPECT_THROW(ReadRecording({{"", folder / "notes.txt"}}, {}, {}), InputError);
}

TEST(FrameDirectories, OneThatMayBeListedButNotSearchedIsNamedItself) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", OnePoint());
  std::filesystem::permissions(folder.path(), static_cast<std::filesystem::perms>(0644));
  std::string message;
  {
    const WithoutPrivileges nobody;
    message = InputMessage(folder);
  }
  std::filesystem::permissions(folder.path(), static_cast<std::filesystem::perms>(0755));
  EXPECT_EQ(message,
            folder.path() + ": Permission denied, expected a directory whose files can be opened");
}

TEST(FrameDirectories, StampsThatCannotBeReadAreNotTakenForNone) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", OnePoint());
  const std::string stamps = folder / "timestamps.csv";
  const auto expect_refused = [&](const std::string& reason) {
    EXPECT_EQ(InputMessage(folder).find(stamps + ": cannot be read (" + reason), 0U)
        << InputMessage(folder);
    std::filesystem::remove(stamps);
  };
  ASSERT_EQ(::mkfifo(stamps.c_str(), 0600), 0);
  expect_refused("not a regular file");
  std::filesystem::create_directory(stamps);
  expect_refused("not a regular file");
  std::filesystem::create_symlink("none", stamps);
  expect_refused("No such file");
  EXPECT_EQ(InputMessage(folder), "");
}

TEST(FrameDirectories, SourcesWithoutANameHaveThatOfTheirDirectory) {
  const TemporaryFolder folder;
  folder.Write("a/mid360/1.0.pcd", OnePoint());
  folder.Write("b/mid360/1.0.pcd", OnePoint());
  const Recording recording =
      ReadRecording({{"", folder / "a/mid360/"}, {"other", folder / "b/mid360/."}}, {}, {});
  ASSERT_EQ(recording.sensors.size(), 2U);
  EXPECT_EQ(recording.sensors[0].name, "mid360");
  EXPECT_EQ(recording.sensors[1].name, "other");
  EXPECT_THROW(ReadRecording({{"", folder / "a/mid360"}, {"", folder / "b/mid360"}}, {}, {}),
               UsageError);
  EXPECT_THROW(ReadRecording({{"x", folder / "a/mid360"}, {"x", folder / "b/mid360"}}, {}, {}),
               UsageError);
}

TEST(FrameStamps, NumbersAreFramesOfTheRateOfTheConfig) {
  const TemporaryFolder folder;
  for (const char* name : {"000007.pcd", "000008.pcd", "000010.pcd"}) {
    folder.Write(name, OnePoint());
  }
  InputConfig config;
  config.frame_rate_hz = 20.0;
  const Recording given = Read(folder, config);
  EXPECT_EQ(given.frames.front().stamp_ns, 350 * kMs);
  EXPECT_EQ(given.frames.back().stamp_ns, 500 * kMs);
  EXPECT_TRUE(given.warnings.empty());
  const Recording assumed = Read(folder);
  EXPECT_EQ(assumed.frames.back().stamp_ns, 1 * kSecond);
  ASSERT_EQ(assumed.warnings.size(), 1U);
  EXPECT_EQ(assumed.warnings[0].code, "numbered_frames");
  folder.Write("timestamps.csv", "file,timestamp\n000007.pcd,7\n000008.pcd,8\n000010.pcd,10\n");
  EXPECT_EQ(Read(folder, config).frames.back().stamp_ns, 10 * kSecond);  // the table has stamps
}

TEST(FrameReturns, CoordinatesThatAreNoMetresAreAnErrorThatTheScaleMends) {
  std::vector<Eigen::Vector3f> rows;
  for (int i = 1; i <= 50; ++i) rows.push_back({400.0F * static_cast<float>(i), 0, 0});
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", BinaryPcd(rows));
  InputConfig config;
  config.skip_bad_frames = true;  // is no help
  const Recording few = Read(folder, config);
  ASSERT_EQ(few.warnings.size(), 1U);
  EXPECT_EQ(few.warnings[0].code, "not_metres");
  for (int k = 2; k < 50; ++k) folder.Write(std::to_string(k) + ".0.pcd", BinaryPcd(rows));
  EXPECT_THROW(Read(folder, config), UnitError);
  EXPECT_NE(InputMessage(folder).find("input.scale_m=0.001"), std::string::npos);
  config.scale_m = 0.001;
  const Recording recording = Read(folder, config);
  EXPECT_EQ(recording.counts.returns, 49U * 49U);  // but for the nearest, at 0.4 m
  EXPECT_FLOAT_EQ(recording.points_m.back().x(), 20.0F);
}

TEST(FrameReturns, RowsAreDroppedByReasonAndCounted) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", BinaryPcd({{0, 0, 0},
                                     {-0.0F, 0, 0},
                                     {nan, 1, 1},
                                     {1, 1, inf},
                                     {0.3F, 0.3F, 0.2F},
                                     {0.5F, 0, 0},
                                     {0, -2000.0F, 0},
                                     {0, -2000.1F, 0},
                                     {3e38F, 3e38F, 3e38F},
                                     {1, 2, 3}}));
  folder.Write("2.0.pcd", BinaryPcd({}));
  folder.Write("3.0.pcd", BinaryPcd({{0, 0, 0}}));
  const Recording recording = Read(folder);
  EXPECT_EQ(recording.points_m,
            (std::vector<Eigen::Vector3f>{{0.5F, 0, 0}, {0, -2000.0F, 0}, {1, 2, 3}}));
  const InputCounts& counts = recording.counts;
  EXPECT_EQ(counts.frames, 3U);
  EXPECT_EQ(counts.empty_frames, 2U);
  EXPECT_EQ(counts.bad_frames, 0U);
  EXPECT_EQ(counts.rows, 11U);
  EXPECT_EQ(counts.no_return_rows, 3U);
  EXPECT_EQ(counts.non_finite_rows, 2U);
  EXPECT_EQ(counts.out_of_range_rows, 3U);
  EXPECT_EQ(counts.returns, 3U);
  EXPECT_EQ(recording.frames[1].first_return, 3U);
  EXPECT_EQ(recording.frames[2].last_return, 3U);
}

TEST(FrameReturns, ThePoseIsAppliedInDoubleAndRangeIsMeasuredFromTheSensor) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", BinaryPcd({{1.0F, 2.0F, 3.0F}}));
  SensorConfig sensor;
  sensor.translation_m = {5000.0, -1.0, 0.25};
  sensor.rotation_xyzw = {0.0, 0.0, std::sqrt(0.5), std::sqrt(0.5)};  // x to y
  const Recording recording = Read(folder, {}, sensor);
  ASSERT_EQ(recording.points_m.size(), 1U);
  EXPECT_TRUE(recording.points_m[0].isApprox(Eigen::Vector3f(4998.0F, 0.0F, 3.25F), 1e-7F));
  EXPECT_EQ(recording.sensors[0].origin_m, Eigen::Vector3f(5000.0F, -1.0F, 0.25F));
  // A sensor that the config does not name stands at the origin.
  EXPECT_EQ(ReadRecording({{"lidar", folder.path()}}, {}, {{"x", sensor}}).points_m[0],
            Eigen::Vector3f(1.0F, 2.0F, 3.0F));
}

// A carrier that drives along x and turns from x to y, ten degrees of 1 s.
PosesByName Driving(const std::string& name) {
  const double half_rad = 5.0 * M_PI / 180.0;
  return {{name,
           std::make_shared<const std::vector<Pose>>(std::vector<Pose>{
               {kSecond, {100.0, 0.0, 0.0}, {0, 0, 0, 1}},
               {2 * kSecond, {110.0, 0.0, 0.0}, {0, 0, std::sin(half_rad), std::cos(half_rad)}}})}};
}

TEST(Poses, ReturnsArePlacedByThePoseAtTheirOwnTimes) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", TimedFrame({0.0, 0.5}, 'F', 4));  // two returns 10 m ahead
  folder.Write("1.5.pcd", TimedFrame({0.25}, 'F', 4));
  SensorConfig sensor;
  sensor.translation_m = {2.0, 0.0, 1.0};
  for (const char* const name : {"lidar", ""}) {
    const Recording recording =
        ReadRecording({{"lidar", folder.path()}}, {}, {{"lidar", sensor}}, Driving(name));
    ASSERT_EQ(recording.points_m.size(), 3U);
    const double half_s_rad = 5.0 * M_PI / 180.0;
    EXPECT_LT((recording.points_m[0] - Eigen::Vector3f(112.0F, 0.0F, 1.0F)).norm(), 1e-4F);
    const Eigen::Vector3d later_m(105.0 + 12.0 * std::cos(half_s_rad), 12.0 * std::sin(half_s_rad),
                                  1.0);
    EXPECT_LT((recording.points_m[1] - later_m.cast<float>()).norm(), 1e-4F);
    // The frame is seen from where the sensor was in its middle, the first one is the origin.
    const double quarter_rad = 2.5 * M_PI / 180.0;
    const Eigen::Vector3d first_m(102.5 + 2.0 * std::cos(quarter_rad), 2.0 * std::sin(quarter_rad),
                                  1.0);
    EXPECT_LT((recording.sensors[0].origin_m - first_m.cast<float>()).norm(), 1e-4F);
    EXPECT_EQ(recording.frames[0].carrier.shift_m, Eigen::Vector3f::Zero());
    const double third_rad = 7.5 * M_PI / 180.0;
    const Eigen::Vector3d second_m(107.5 + 2.0 * std::cos(third_rad), 2.0 * std::sin(third_rad),
                                   1.0);
    EXPECT_LT((recording.frames[1].carrier.shift_m - (second_m - first_m).cast<float>()).norm(),
              1e-4F);
    EXPECT_NE(recording.sensors[0].carrier, nullptr);
  }
  EXPECT_EQ(ReadRecording({{"lidar", folder.path()}}, {}, {{"lidar", sensor}}, Driving("other"))
                .points_m[0],
            Eigen::Vector3f(12.0F, 0.0F, 1.0F));
}

TEST(Poses, FramesWithoutThemAreLeftOutAndCounted) {
  const TemporaryFolder folder;
  for (const char* const stamp : {"0.5", "0.8", "1.0", "1.5", "1.9"}) {
    folder.Write(std::string(stamp) + ".pcd", TimedFrame({0.0, 0.2}, 'F', 4));
  }
  const Recording recording = ReadRecording({{"lidar", folder.path()}}, {}, {}, Driving(""));
  EXPECT_EQ(Stamps(recording), (std::vector<TimeNs>{kSecond, 1500 * kMs}));
  EXPECT_EQ(recording.counts.unplaced_frames, 3U);
  EXPECT_EQ(recording.counts.frames, 2U);
  ASSERT_EQ(recording.warnings.size(), 1U);
  EXPECT_EQ(recording.warnings[0].code, "frames_without_pose");
}

TEST(FrameOrder, SensorsAreMergedByStampThenByIndexWithTheirTimeOffsets) {
  const TemporaryFolder folder;
  folder.Write("a/1.0.pcd", OnePoint(1));
  folder.Write("a/2.0.pcd", OnePoint(2));
  folder.Write("b/1.5.pcd", OnePoint(3));
  folder.Write("b/2.5.pcd", BinaryPcd({{4, 0, 0}, {5, 0, 0}}));
  SensorConfig late;
  late.time_offset_s = -0.5;
  const Recording recording =
      ReadRecording({{"", folder / "a"}, {"", folder / "b"}}, {}, {{"b", late}});
  EXPECT_EQ(Stamps(recording), (std::vector<TimeNs>{kSecond, kSecond, 2 * kSecond, 2 * kSecond}));
  std::vector<float> x;
  for (const FrameInfo& frame : recording.frames) {
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      x.push_back(recording.points_m[i].x());
      EXPECT_EQ(recording.times_ns[i], frame.stamp_ns + kSecond / 2);
    }
  }
  EXPECT_EQ(x, (std::vector<float>{1, 3, 2, 4, 5}));
  EXPECT_EQ(recording.frames[1].sensor, 1U);
  EXPECT_EQ(recording.frames.back().last_return, recording.points_m.size());
}

TEST(FrameIntervals, AreOnePeriodLongAboutTheStampAsConfigured) {
  const TemporaryFolder folder;
  for (const char* name : {"10.0.pcd", "10.1.pcd", "10.2.pcd", "15.0.pcd"}) {
    folder.Write(name, OnePoint());
  }
  const std::pair<StampMeaning, TimeNs> cases[] = {{StampMeaning::kBegin, 0},
                                                   {StampMeaning::kMiddle, -50 * kMs},
                                                   {StampMeaning::kEnd, -100 * kMs}};
  for (const auto& [meaning, begin_ns] : cases) {
    InputConfig config;
    config.stamp = meaning;
    const Recording recording = Read(folder, config);
    EXPECT_EQ(recording.sensors[0].frame_period_ns, 100 * kMs);  // the median, not the mean
    for (std::size_t i = 0; i < 4; ++i) {
      const FrameInfo& frame = recording.frames[i];
      EXPECT_EQ(frame.begin_ns, frame.stamp_ns + begin_ns);
      EXPECT_EQ(frame.end_ns, frame.begin_ns + 100 * kMs);
      EXPECT_EQ(recording.times_ns[i], frame.begin_ns + 50 * kMs);
    }
  }
}

TEST(FrameIntervals, OfASingleFrameAreATenthOfASecond) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", OnePoint());
  EXPECT_EQ(Read(folder).sensors[0].frame_period_ns, 100 * kMs);
}

TEST(FrameIntervals, AreAtMostASecondHoweverFarApartTheStampsAre) {
  for (const int period_s : {2, 60, 3600, 100'000}) {
    const TemporaryFolder folder;
    for (int i = 1; i <= 3; ++i) folder.Write(std::to_string(i * period_s) + ".0.pcd", OnePoint());
    const std::pair<StampMeaning, TimeNs> cases[] = {{StampMeaning::kBegin, 0},
                                                     {StampMeaning::kMiddle, -500 * kMs},
                                                     {StampMeaning::kEnd, -1000 * kMs}};
    for (const auto& [meaning, begin_ns] : cases) {
      InputConfig config;
      config.stamp = meaning;
      const Recording recording = Read(folder, config);
      EXPECT_EQ(recording.sensors[0].frame_period_ns, std::min(period_s, 3600) * kSecond);
      for (std::size_t i = 0; i < 3; ++i) {
        const FrameInfo& frame = recording.frames[i];
        EXPECT_EQ(frame.begin_ns, frame.stamp_ns + begin_ns);
        EXPECT_EQ(frame.end_ns, frame.begin_ns + kSecond);
        EXPECT_EQ(recording.times_ns[i], frame.begin_ns + kSecond / 2);
      }
    }
  }
}

TEST(FrameIntervals, StampsAtBothEndsOfTimeDoNotOverflow) {
  const TemporaryFolder folder;
  folder.Write("-4000000000.0.pcd", OnePoint());
  folder.Write("4000000000.0.pcd", OnePoint());
  InputConfig config;
  config.stamp = StampMeaning::kEnd;
  const Recording recording = Read(folder, config);
  EXPECT_EQ(recording.frames[0].end_ns, -4'000'000'000 * kSecond);
  EXPECT_EQ(recording.frames[0].begin_ns, recording.frames[0].end_ns - kSecond);
  EXPECT_EQ(recording.frames[1].end_ns, 4'000'000'000 * kSecond);
  folder.Write("4000000000.1.pcd", OnePoint());
  EXPECT_NE(InputMessage(folder).find("4000000000.1"), std::string::npos);
}

// Two sensors with offsets to either side could be farther apart than 64 bits reach.
TEST(FrameIntervals, ATimeOffsetDoesNotLeadBeyondTheEndsOfTime) {
  const TemporaryFolder folder;
  folder.Write("-3999999999.0.pcd", OnePoint());
  folder.Write("3999999999.0.pcd", OnePoint());
  InputConfig config;
  config.skip_bad_frames = true;  // not the frame is bad but the clock
  for (const double offset_s : {1.0, -1.0}) {
    SensorConfig sensor;
    sensor.time_offset_s = offset_s;
    EXPECT_EQ(Read(folder, config, sensor).frames.size(), 2U);
    sensor.time_offset_s = 1e9 * offset_s;
    try {
      Read(folder, config, sensor);
      ADD_FAILURE() << offset_s;
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_EQ(message.find(folder / (offset_s > 0 ? "3999999999.0.pcd" : "-3999999999.0.pcd")),
                0U)
          << message;
      EXPECT_NE(message.find("time offset of"), std::string::npos) << message;
    }
  }
}

TEST(BadFrames, AreErrorsUnlessSkippedAndThenCounted) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", OnePoint(1));
  folder.Write("2.0.pcd", "no frame");
  folder.Write("3.0.pcd", OnePoint(3).substr(0, 150));
  folder.Write("4.0.pcd", OnePoint(4));
  EXPECT_NE(InputMessage(folder).find("2.0.pcd"), std::string::npos);
  InputConfig config;
  config.skip_bad_frames = true;
  const Recording recording = Read(folder, config);
  EXPECT_EQ(Stamps(recording), (std::vector<TimeNs>{kSecond, 4 * kSecond}));
  EXPECT_EQ(recording.counts.bad_frames, 2U);
  EXPECT_EQ(recording.counts.frames, 2U);
  EXPECT_EQ(recording.counts.rows, 2U);
}

TEST(BadFrames, ASourceWithoutAnyGoodFrameIsRefused) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", "no frame");
  InputConfig config;
  config.skip_bad_frames = true;
  EXPECT_NE(InputMessage(folder, config).find("none of its 1 frames"), std::string::npos);
}

TEST(FrameReader, PartsMakeTheSameRecording) {
  const TemporaryFolder folder;
  for (int i = 0; i < 20; ++i) {
    folder.Write("a/" + std::to_string(kUnix + i * 100 * kMs) + ".pcd",
                 TimedFrame({0.01 * i, 0.02 * i}, 'F', 8));
    folder.Write("b/" + std::to_string(kUnix + i * 70 * kMs) + ".pcd",
                 OnePoint(5.0F + static_cast<float>(i)));
  }
  const std::vector<FrameSource> sources = {{"", folder / "a"}, {"", folder / "b"}};
  SensorConfig late;
  late.time_offset_s = 0.25;
  Config config;
  config.sensors = {{"b", late}};
  const Recording whole = ReadRecording(sources, config.input, config.sensors);
  FrameReader reader(sources, config);
  EXPECT_EQ(reader.first_stamp_ns(), whole.frames.front().stamp_ns);
  EXPECT_EQ(reader.last_stamp_ns(), whole.frames.back().stamp_ns);
  Recording parts;
  TimeNs next_ns = reader.first_stamp_ns();
  while (next_ns != std::numeric_limits<TimeNs>::max()) {
    const std::size_t known = parts.frames.size();
    const TimeNs first_ns = next_ns;
    next_ns = reader.ReadUntil(next_ns + 300 * kMs, &parts);
    ASSERT_GT(parts.frames.size(), known);
    EXPECT_EQ(parts.frames[known].stamp_ns, first_ns);
  }
  EXPECT_EQ(parts.points_m, whole.points_m);
  EXPECT_EQ(testing::TimesOf(parts.times_ns), testing::TimesOf(whole.times_ns));
  ASSERT_EQ(parts.frames.size(), whole.frames.size());
  for (std::size_t i = 0; i < parts.frames.size(); ++i) {
    EXPECT_EQ(parts.frames[i].sensor, whole.frames[i].sensor);
    EXPECT_EQ(parts.frames[i].stamp_ns, whole.frames[i].stamp_ns);
    EXPECT_EQ(parts.frames[i].last_return, whole.frames[i].last_return);
  }
  EXPECT_EQ(parts.counts.frames, whole.counts.frames);
  EXPECT_EQ(parts.counts.returns, whole.counts.returns);
  EXPECT_EQ(parts.sensors[1].frame_period_ns, whole.sensors[1].frame_period_ns);
}

TEST(FrameReader, ReadsTheSameOnSeveralThreadsAndNamesTheSameBadFrame) {
  const TemporaryFolder folder;
  for (int i = 0; i < 30; ++i) {
    folder.Write("a/" + std::to_string(kUnix + i * 100 * kMs) + ".pcd",
                 OnePoint(5.0F + static_cast<float>(i)));
  }
  const Recording one = ReadRecording({{"", folder / "a"}}, {}, {});
  const testing::Threads several(4);
  EXPECT_EQ(ReadRecording({{"", folder / "a"}}, {}, {}).points_m, one.points_m);
  for (const int bad : {11, 12, 25}) {
    folder.Write("a/" + std::to_string(kUnix + bad * 100 * kMs) + ".pcd", "no PCD");
  }
  try {
    ReadRecording({{"", folder / "a"}}, {}, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(std::to_string(kUnix + 1100 * kMs)),
              std::string::npos);
  }
  InputConfig skip;
  skip.skip_bad_frames = true;
  const Recording rest = ReadRecording({{"", folder / "a"}}, skip, {});
  EXPECT_EQ(rest.frames.size(), 27U);
  EXPECT_EQ(rest.counts.bad_frames, 3U);
}

}  // namespace
}  // namespace unlidar
