#include "app/live_output.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "app/output.hpp"
#include "temporary_folder.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kSecondNs = 1'000'000'000;

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
  LiveOutput output_{path_, "", signals_, [](const std::string&) {}};

  // A track of which the n-th second is told with the n-th of these probabilities.
  std::string WrittenOf(const std::vector<double>& drones, int track_id = 0) {
    output_.Confirm({track_id, 0, {drones.front(), 1.0 - drones.front(), 0.0}});
    int second = 0;
    for (const double drone : drones) {
      ++second;
      output_.Give(second * kSecondNs, Row(second, drone, track_id));
    }
    output_.End(second * kSecondNs, {track_id, second * kSecondNs, {}});
    output_.Flush();
    return ReadFile(path_);
  }
};

TEST_F(OnlyDrones, RowsWaitForTheProbabilityAndThenAllAreWritten) {
  output_.KeepOnlyDrones(0.8, 60 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.2, 0.7, 0.8, 0.9}), Text({1, 2, 3, 4}));
  EXPECT_EQ(output_.tracks_left_out(), 0U);
}

TEST_F(OnlyDrones, OnceReachedItHolds) {
  output_.KeepOnlyDrones(0.8, 60 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.2, 0.9, 0.1, 0.0}), Text({1, 2, 3, 4}));
}

TEST_F(OnlyDrones, WhatIsNeverLikelyEnoughIsLeftOutAndTakesNoNumber) {
  output_.KeepOnlyDrones(0.8, 60 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.2, 0.7, 0.79}), Text({}));
  EXPECT_EQ(output_.tracks_left_out(), 1U);
  EXPECT_TRUE(output_.tracks().empty());
  EXPECT_EQ(WrittenOf({0.9}, 1), Text({1}, 0));
}

TEST_F(OnlyDrones, RowsThatWaitedTooLongAreForgotten) {
  output_.KeepOnlyDrones(0.8, 2 * kSecondNs);
  EXPECT_EQ(WrittenOf({0.2, 0.2, 0.2, 0.2, 0.2, 0.9}), Text({3, 4, 5, 6}));
}

TEST_F(OnlyDrones, WithoutItNothingWaits) { EXPECT_EQ(WrittenOf({0.0, 0.0}), Text({1, 2})); }

// The next run numbers on from the rows, which is all that it can read.
TEST(LiveOutput, ATrackIsToldWithItsFirstRowSoThatNoKillMakesTwoOfOneNumber) {
  const testing::TemporaryFolder folder;
  const std::string events = folder / "events.jsonl";
  Signals signals;
  LiveOutput output(folder / "traj.csv", events, signals, [](const std::string&) {});
  output.Confirm({0, 0, {}});
  output.Flush();
  EXPECT_EQ(ReadFile(events), "");
  output.Give(kSecondNs, Row(1, 0.5));
  output.Flush();
  const std::string told = ReadFile(events);
  EXPECT_EQ(told.find("{\"event\":\"track\""), 0U);
  EXPECT_NE(told.find("{\"event\":\"row\""), std::string::npos);
}

}  // namespace
}  // namespace unlidar
