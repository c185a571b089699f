#include "app/output.hpp"

#include <gtest/gtest.h>

#include <clocale>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "app/summary.hpp"
#include "base/format.hpp"
#include "config/config.hpp"
#include "io/pcd.hpp"
#include "tests/config_entries.hpp"
#include "tests/temporary_folder.hpp"

namespace unlidar {
namespace {

using ::unlidar::testing::ConfigEntry;
using ::unlidar::testing::ListConfig;
using ::unlidar::testing::TemporaryFolder;

constexpr TimeNs kBeginNs = 1'706'255'621'600'227'001;

TrajectoryRow Row(int track_id, TimeNs time_ns) {
  TrajectoryRow row;
  row.time_ns = time_ns;
  row.track_id = track_id;
  row.position_m = {1.5, -2.25, 1e-9};
  row.velocity_mps = {-1e-9, 0.1, 1234567.0};
  row.sigma_m = {0.01, 0.02, 0.03};
  row.support = 7;
  return row;
}

RowStream Rows(int track_id, const std::vector<TimeNs>& times_ns) {
  return [=, i = std::size_t{0}]() mutable -> std::optional<TrajectoryRow> {
    if (i == times_ns.size()) return std::nullopt;
    return Row(track_id, times_ns[i++]);
  };
}

std::string CsvOf(const std::vector<RowStream>& tracks) {
  std::string text;
  WriteTrajectoryCsv(tracks, [&](std::string_view bytes) { text += bytes; });
  return text;
}

std::string TumOf(const RowStream& track) {
  std::string text;
  WriteTrajectoryTum(track, [&](std::string_view bytes) { text += bytes; });
  return text;
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

TEST(SecondsText, IsExactAtBothEndsOfTime) {
  EXPECT_EQ(SecondsText(0), "0.000000000");
  EXPECT_EQ(SecondsText(1), "0.000000001");
  EXPECT_EQ(SecondsText(-1), "-0.000000001");
  EXPECT_EQ(SecondsText(kBeginNs), "1706255621.600227001");
  EXPECT_EQ(SecondsText(std::numeric_limits<TimeNs>::max()), "9223372036.854775807");
  EXPECT_EQ(SecondsText(std::numeric_limits<TimeNs>::min()), "-9223372036.854775808");
}

TEST(FixedText, IsPlainDecimalInEveryLocaleAndNeverMinusZero) {
  std::setlocale(LC_ALL, "de_DE.UTF-8");
  EXPECT_EQ(FixedText(1234567.125, 3), "1234567.125");
  EXPECT_EQ(FixedText(-1e-9, 6), "0.000000");
  EXPECT_EQ(FixedText(-0.5, 1), "-0.5");
  EXPECT_EQ(FixedText(std::nan(""), 2), "nan");
  EXPECT_EQ(FixedText(std::numeric_limits<double>::max(), 0).size(), 309U);
  EXPECT_EQ(ShortestText(0.1), "0.1");
  std::setlocale(LC_ALL, "C");
}

TEST(WriteTrajectoryCsv, WithoutATrackIsTheHeader) {
  EXPECT_EQ(CsvOf({}), "timestamp,track_id,x,y,z,vx,vy,vz,sigma_x,sigma_y,sigma_z,support\n");
}

TEST(WriteTrajectoryCsv, ListsRowsInOrderOfTimeThenTrack) {
  const std::vector<std::string> lines =
      Lines(CsvOf({Rows(0, {kBeginNs, kBeginNs + 2}),
                   Rows(1, {kBeginNs - 1, kBeginNs, kBeginNs + 1}), Rows(2, {})}));
  ASSERT_EQ(lines.size(), 6U);
  EXPECT_EQ(lines[1].substr(0, 22), "1706255621.600227000,1");
  EXPECT_EQ(lines[2],
            "1706255621.600227001,0,1.500000,-2.250000,0.000000,0.000000,0.100000,1234567.000000,"
            "0.010000,0.020000,0.030000,7");
  EXPECT_EQ(lines[3].substr(0, 22), "1706255621.600227001,1");
  EXPECT_EQ(lines[4].substr(0, 22), "1706255621.600227002,1");
  EXPECT_EQ(lines[5].substr(0, 22), "1706255621.600227003,0");
}

TEST(WriteTrajectoryTum, HoldsPositionsAndTheIdentity) {
  EXPECT_EQ(TumOf(Rows(3, {kBeginNs})),
            "# timestamp tx ty tz qx qy qz qw\n"
            "1706255621.600227001 1.500000 -2.250000 0.000000 0 0 0 1\n");
  EXPECT_EQ(TumOf({}), "# timestamp tx ty tz qx qy qz qw\n");
}

TEST(ClustersCsv, HasAsManyValuesAsNamesAndReadsBackExactly) {
  ClusterScore score;
  score.id = 4;
  score.eligible = true;
  score.first_ns = kBeginNs;
  score.psi = 0.1 + 0.2;
  score.merged_density_per_m3 = 1e260;
  const std::vector<std::string> lines = Lines(ClustersCsv({score, score}));
  ASSERT_EQ(lines.size(), 3U);
  const auto commas = [](const std::string& line) {
    return std::count(line.begin(), line.end(), ',');
  };
  EXPECT_EQ(commas(lines[0]), commas(lines[1]));
  EXPECT_EQ(lines[1], lines[2]);
  std::vector<std::string> values;
  std::istringstream stream(lines[1]);
  for (std::string value; std::getline(stream, value, ',');) values.push_back(value);
  EXPECT_EQ(values[7], "1706255621.600227001");
  EXPECT_EQ(std::stod(values[17]), 1e260);
  EXPECT_EQ(std::stod(values[23]), 0.1 + 0.2);
}

TEST(TargetPointsPcd, HoldsTheReturnsOfAllTracks) {
  Recording recording;
  recording.points_m = {{0, 0, 0}, {1, 2, 3}, {4, 5, 6}, {7, 8, 9}};
  std::vector<FittedTrack> tracks(2);
  tracks[0].returns = {1, 3};
  tracks[1].returns = {2};
  const TemporaryFolder folder;
  const PcdCloud cloud = ReadPcd(folder.Write("points.pcd", TargetPointsPcd(recording, tracks)));
  ASSERT_EQ(cloud.points_m.size(), 3U);
  EXPECT_EQ(cloud.points_m[1], Eigen::Vector3f(7, 8, 9));
  EXPECT_EQ(cloud.points_m[2], Eigen::Vector3f(4, 5, 6));
}

TEST(SummaryJson, HoldsEveryConfigKeyCountsTimesAndTracks) {
  PipelineResult result;
  result.recording.sensors.resize(1);
  result.recording.frames.resize(3);
  result.blinded_s = {1.5};
  result.sway_deg = {0.7};
  result.recording.counts.frames = 3;
  result.recording.counts.bad_frames = 2;
  result.times = {{"read", 0.25}};
  FittedTrack track;
  track.row_source.trajectory.origin_ns = kBeginNs;
  track.row_source.trajectory.duration_ns = 1'500'000'000;
  track.length_m = 3.0;
  track.num_rows = 2;
  track.row_source.trajectory.minimum = {"ceres", 9, true, 20.5, 18.25, "CONVERGENCE"};
  result.tracks = {track};
  Config config;
  config.sensors["avia"].translation_m = {1, 2, 3};
  const std::string not_utf8 = "frames\xFF";
  const auto summary = nlohmann::json::parse(SummaryJson({{"avia", not_utf8}}, config, result));
  EXPECT_EQ(summary["inputs"][0]["frames"], 3);
  EXPECT_EQ(summary["inputs"][0]["blinded_s"], 1.5);
  EXPECT_EQ(summary["inputs"][0]["sway_deg"], 0.7);
  EXPECT_EQ(summary["counts"]["bad_frames"], 2);
  EXPECT_EQ(summary["counts"]["trajectory_rows"], 2);
  EXPECT_FALSE(summary["counts"].contains("robust"));
  EXPECT_EQ(summary["times_s"]["read"], 0.25);
  EXPECT_EQ(summary["tracks"][0]["begin"], "1706255621.600227001");
  EXPECT_EQ(summary["tracks"][0]["mean_speed_mps"], 2.0);
  EXPECT_EQ(summary["tracks"][0]["spline"], nlohmann::json({{"solver", "ceres"},
                                                            {"iterations", 9},
                                                            {"initial_cost", 20.5},
                                                            {"final_cost", 18.25},
                                                            {"termination", "CONVERGENCE"}}));
  EXPECT_EQ(summary["config"]["sensors"]["avia"]["translation_m"][2], 3.0);
  for (const ConfigEntry& entry : ListConfig(config)) {
    std::string pointer = "/" + entry.key;
    std::replace(pointer.begin(), pointer.end(), '.', '/');
    EXPECT_TRUE(summary["config"].contains(nlohmann::json::json_pointer(pointer))) << entry.key;
  }
}

TEST(NotConvergedText, NamesTrackCauseAndWhatIsWritten) {
  EXPECT_EQ(NotConvergedText(3, {"banded", 500, false, 20.5, 18.25, "NO_CONVERGENCE"}),
            "track 3: Ceres did not converge in 500 iterations (NO_CONVERGENCE); written is the "
            "minimum of the banded solver");
}

TEST(SummaryJson, HoldsTheCountsOfTheRobustMethod) {
  PipelineResult result;
  result.robust_counts = RobustCounts{11, 12, 13, 14, 15.5, 0.001};
  const auto counts = nlohmann::json::parse(SummaryJson({}, Config(), result))["counts"]["robust"];
  EXPECT_EQ(counts, nlohmann::json({{"unexplained_returns", 11},
                                    {"body_returns", 12},
                                    {"plots", 13},
                                    {"paths", 14},
                                    {"score_threshold", 15.5},
                                    {"false_alarms", 0.001}}));
}

}  // namespace
}  // namespace unlidar
