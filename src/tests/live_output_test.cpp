#include "app/live_output.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "app/output.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kSecondNs = 1'000'000'000;
const RowTimes kRows(60 * kSecondNs, 1000 * kSecondNs);

// Rows a second apart, of which the track is a drone with this probability.
RowGiven Row(int second, double drone, int track_id = 0) {
  RowGiven given;
  given.row.time_ns = second * kSecondNs;
  given.row.track_id = track_id;
  given.kind = {drone, 1.0 - drone, 0.0};
  return given;
}

std::string Text(const std::vector<int>& seconds, int track_id = 0) {
  std::string text = kTrajectoryHeader;
  for (const int second : seconds) AppendTrajectoryRow(Row(second, 0.0).row, track_id, text);
  return text;
}

std::string ReadFile(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

class OnlyDrones : public ::testing::Test {
 protected:
  testing::TemporaryFolder folder_;
  std::string path_ = folder_ / "traj.csv";
  Signals signals_;
  LiveOutput output_{path_, "", kRows, signals_, [](const std::string&) {}};

  // A track of which the n-th second is told with the n-th of these probabilities.
  std::string WrittenOf(const std::vector<double>& drones, int track_id = 0) {
    output_.Confirm({track_id, 0, {drones.front(), 1.0 - drones.front(), 0.0}});
    int second = 0;
    for (const double drone : drones) {
      ++second;
      output_.AddRow(second * kSecondNs, Row(second, drone, track_id));
    }
    output_.End(second * kSecondNs, {track_id, second * kSecondNs, {}});
    output_.Flush();
    return ReadFile(path_);
  }
};

TEST_F(OnlyDrones, RowsOfABirdWaitAndFollowWhenItIsNoneAfterAll) {
  output_.LeaveOutBirds(0.7, 60 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.2, 0.29, 0.31, 0.9}), Text({1, 2, 3, 4}));
  EXPECT_EQ(output_.counts().tracks_left_out, 0U);
}

TEST_F(OnlyDrones, ATrackIsWrittenAtOnceAndNoLongerWhenItIsSurelyABird) {
  output_.LeaveOutBirds(0.7, 60 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.5, 0.4, 0.1, 0.0}), Text({1, 2}));
  EXPECT_EQ(output_.counts().tracks_left_out, 0U);
}

TEST_F(OnlyDrones, WhatIsSurelyABirdThroughoutIsLeftOutAndTakesNoNumber) {
  output_.LeaveOutBirds(0.7, 60 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.2, 0.1, 0.29}), Text({}));
  EXPECT_EQ(output_.counts().tracks_left_out, 1U);
  EXPECT_TRUE(output_.tracks().empty());
  EXPECT_EQ(WrittenOf({0.9}, 1), Text({1}, 0));
}

TEST_F(OnlyDrones, RowsThatWaitedTooLongAreForgotten) {
  output_.LeaveOutBirds(0.7, 2 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.2, 0.2, 0.2, 0.2, 0.2, 0.9}), Text({3, 4, 5, 6}));
}

TEST_F(OnlyDrones, WithoutItNothingWaits) { EXPECT_EQ(WrittenOf({0.0, 0.0}), Text({1, 2})); }

// The next run numbers on from the rows, which is all that it can read.
TEST(LiveOutput, NumbersThatJsonDoesNotHaveAreNeverWritten) {
  const testing::TemporaryFolder folder;
  Signals signals;
  const std::string path = folder / "traj.csv";
  LiveOutput output(path, folder / "events.jsonl", kRows, signals, [](const std::string&) {});
  output.Confirm({0, 0, {}});
  output.AddRow(kSecondNs, Row(1, 0.5));
  for (const double value : {std::nan(""), HUGE_VAL, -HUGE_VAL, 1e300}) {
    RowGiven given = Row(2, 0.5);
    given.row.position_m.y() = value;
    output.AddRow(2 * kSecondNs, given);
    given = Row(2, 0.5);
    given.row.sigma_m.z() = value;
    output.AddRow(2 * kSecondNs, given);
  }
  output.Flush();
  EXPECT_EQ(ReadFile(path), Text({1}));
  EXPECT_EQ(output.counts().unwritable_rows, 8U);
}

TEST(LiveOutput, RowsThatTheFileHoldsAreLeftOutAndCounted) {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "traj.csv";
  Signals signals;
  std::ofstream(path) << Text({1, 2, 3});
  LiveOutput output(path, "", kRows, signals, [](const std::string&) {});
  output.SkipRows(std::nullopt, *output.row_times().latest_ns());
  for (const int second : {2, 3, 4}) output.AddRow(second * kSecondNs, Row(second, 0.5));
  EXPECT_EQ(output.counts().left_out_rows, 2U);
}

TEST(RowTimes, TheLatestIsThatOfTheClockOfTheEnd) {
  const auto latest_s = [](const std::vector<TimeNs>& seconds) {
    RowTimes rows = kRows;
    for (const TimeNs second : seconds) rows.Add(second * kSecondNs);
    return *rows.latest_ns() / kSecondNs;
  };
  EXPECT_EQ(latest_s({100, 160, 130, 131}), 160);          // a track that was confirmed late
  EXPECT_EQ(latest_s({500, 600, 100, 101}), 101);          // the clock was set back
  EXPECT_EQ(latest_s({100, 3'960'000, 101}), 101);         // glitched,
  EXPECT_EQ(latest_s({100, 101, 3'960'000}), 101);         // also at the end
  EXPECT_EQ(latest_s({3'960'000, 3'960'001}), 3'960'001);  // this computer's clock is wrong
}

TEST(LiveOutput, AFirstRowThatIsNotLaterThanTheFileIsRefusedAndAnyAfterALaterOneIsNot) {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "traj.csv";
  const std::string events = folder / "events.jsonl";
  Signals signals;
  const auto ignore = [](const std::string&) {};
  std::ofstream(path) << Text({1, 2, 3});
  for (const int second : {2, 3}) {
    LiveOutput output(path, events, kRows, signals, ignore);
    output.RefuseEarlierRows();
    output.ReportState(0, LiveState::kWarmingUp, 1, 0);
    output.Flush();
    EXPECT_NE(ReadFile(events), "");  // which wait for no row
    output.Confirm({0, 0, {}});
    EXPECT_THROW(output.AddRow(second * kSecondNs, Row(second, 0.5)), OutputError);
    output.Flush();
    EXPECT_EQ(ReadFile(path), Text({1, 2, 3}));
    EXPECT_EQ(ReadFile(events).find("\"row\""), std::string::npos);
  }
  LiveOutput output(path, events, kRows, signals, ignore);
  output.RefuseEarlierRows();
  output.Confirm({0, 0, {}});
  output.AddRow(4 * kSecondNs, Row(4, 0.5));
  output.AddRow(kSecondNs, Row(1, 0.5));  // the clock of the station went back
  output.Flush();
  std::string rows = Text({1, 2, 3});
  AppendTrajectoryRow(Row(4, 0.0).row, 1, rows);
  AppendTrajectoryRow(Row(1, 0.0).row, 1, rows);
  EXPECT_EQ(ReadFile(path), rows);
}

TEST(LiveOutput, RowsThatWereHeldAreRefusedByTheFirstOfThem) {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "traj.csv";
  Signals signals;
  std::ofstream(path) << Text({1, 2, 3});
  LiveOutput output(path, "", kRows, signals, [](const std::string&) {});
  output.RefuseEarlierRows();
  output.LeaveOutBirds(0.4, 60 * kSecondNs);
  output.Confirm({0, 0, {}});
  output.AddRow(3 * kSecondNs, Row(3, 0.5));
  EXPECT_THROW(output.AddRow(4 * kSecondNs, Row(4, 0.9)), OutputError);
}

TEST(LiveOutput, ATrackIsToldWithItsFirstRowSoThatNoKillMakesTwoOfOneNumber) {
  const testing::TemporaryFolder folder;
  const std::string events = folder / "events.jsonl";
  Signals signals;
  LiveOutput output(folder / "traj.csv", events, kRows, signals, [](const std::string&) {});
  output.Confirm({0, 0, {}});
  output.Flush();
  EXPECT_EQ(ReadFile(events), "");
  output.AddRow(kSecondNs, Row(1, 0.5));
  output.Flush();
  const std::string told = ReadFile(events);
  EXPECT_EQ(told.find("{\"event\":\"track\""), 0U);
  EXPECT_NE(told.find("{\"event\":\"row\""), std::string::npos);
}

}  // namespace
}  // namespace unlidar
