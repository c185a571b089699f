#include "recording/pipeline.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "app/output.hpp"
#include "io/pcd.hpp"
#include "io/stamp.hpp"
#include "tests/draws.hpp"
#include "tests/fit_trajectory.hpp"
#include "tests/read_recording.hpp"
#include "tests/synthetic_recording.hpp"
#include "tests/temporary_folder.hpp"
#include "trajectory/sampling.hpp"

namespace unlidar {
namespace {

using ::unlidar::testing::TemporaryFolder;

constexpr TimeNs kSecond = 1'000'000'000;
constexpr TimeNs kPeriodNs = 100'000'000;
constexpr TimeNs kBeginNs = 1'700'000'000 * kSecond;
constexpr int kFrames = 40;

Eigen::Vector3d DroneAt(double time_s) { return {-8.0 + 4.0 * time_s, 10.0, 12.0}; }

// A drone that crosses at 4 m/s with six returns a frame, and a static wall.
void WriteFlight(const TemporaryFolder& folder, const std::string& name) {
  for (int i = 0; i < kFrames; ++i) {
    std::vector<Eigen::Vector3f> points_m;
    for (int k = 0; k < 6; ++k) {
      // Returns that see the drone evenly in each direction: their mean is its position.
      Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();
      offset_m[k % 3] = k < 3 ? 0.1 : -0.1;
      points_m.emplace_back((DroneAt(0.1 * i + 0.05) + offset_m).cast<float>());
    }
    for (int k = 0; k < 200; ++k) {
      points_m.emplace_back(20.0F, 0.1F * static_cast<float>(k % 20),
                            0.1F * static_cast<float>(k / 20) + 0.001F * static_cast<float>(i % 7));
    }
    folder.Write(name + "/" + std::to_string(kBeginNs + i * kPeriodNs) + ".pcd",
                 BinaryPcd(points_m));
  }
}

Config PaperMethod() {
  Config config;
  config.method = Method::kPaper;
  return config;
}

PipelineResult RunQuietly(const PipelineRequest& request, const Config& config) {
  return RunPipeline(request, config, [](const StageTime&, const std::string&) {});
}

std::vector<TrajectoryRow> Drained(const RowStream& stream) {
  std::vector<TrajectoryRow> rows;
  while (const auto row = stream()) rows.push_back(*row);
  EXPECT_FALSE(stream().has_value());  // at every further call
  return rows;
}

std::string CsvOf(const PipelineResult& result) {
  std::string text;
  WriteTrajectoryCsv({RowsOf(result, result.tracks.front())},
                     [&](std::string_view bytes) { text += bytes; });
  return text;
}

// A recording of frames with so many returns each.
Recording FramesOf(const std::vector<std::uint32_t>& returns_of_frames) {
  Recording recording;
  recording.sensors.resize(1);
  recording.sensors.front().frame_period_ns = kPeriodNs;
  TimeNs stamp_ns = 0;
  for (const std::uint32_t count : returns_of_frames) {
    FrameInfo frame;
    frame.stamp_ns = frame.begin_ns = stamp_ns;
    frame.end_ns = stamp_ns + kPeriodNs;
    frame.first_return = static_cast<std::uint32_t>(recording.points_m.size());
    frame.last_return = frame.first_return + count;
    for (std::uint32_t i = 0; i < count; ++i) {
      recording.points_m.emplace_back(1.0F, 0.0F, 0.0F);
      recording.times_ns.push_back(stamp_ns + kPeriodNs / 2);
    }
    recording.frames.push_back(frame);
    stamp_ns += kPeriodNs;
  }
  return recording;
}

std::vector<Measurement> Straight(int count) {
  std::vector<Measurement> measurements(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    Measurement& measurement = measurements[static_cast<std::size_t>(i)];
    measurement.time_ns = i * kPeriodNs + kPeriodNs / 2;
    measurement.position_m = {0.3 * i, 0.4 * i, 0.0};
    measurement.covariance_m2 *= 1e-4;
  }
  return measurements;
}

TEST(Pipeline, FollowsADroneFromFramesToRows) {
  const TemporaryFolder folder;
  WriteFlight(folder, "frames");
  PipelineRequest request;
  request.sources = {{"", folder / "frames"}};
  const PipelineResult result = RunQuietly(request, PaperMethod());
  ASSERT_EQ(result.tracks.size(), 1U);
  const FittedTrack& track = result.tracks.front();
  EXPECT_EQ(track.id(), 0);
  EXPECT_EQ(track.returns.size(), 6U * kFrames);
  EXPECT_NEAR(track.length_m, 4.0 * 3.9, 0.05);
  const std::vector<TrajectoryRow> rows = Drained(RowsOf(result, track));
  ASSERT_EQ(rows.size(), static_cast<std::size_t>(kFrames));  // the first stamp, too
  EXPECT_EQ(track.num_rows, rows.size());
  for (const TrajectoryRow& row : rows) {
    const double time_s = static_cast<double>(row.time_ns - kBeginNs) * kSecondsPerNs;
    EXPECT_LT((row.position_m - DroneAt(time_s)).norm(), 0.05) << time_s;
    EXPECT_LT((row.velocity_mps - Eigen::Vector3d(4, 0, 0)).norm(), 0.3) << time_s;
    EXPECT_EQ(row.support, 6);
    EXPECT_EQ(row.track_id, 0);
  }
}

TEST(Pipeline, GivesTheSameBytesTwice) {
  const TemporaryFolder folder;
  WriteFlight(folder, "frames");
  PipelineRequest request;
  request.sources = {{"", folder / "frames"}};
  request.output_times = ParseRate("33");
  EXPECT_EQ(CsvOf(RunQuietly(request, PaperMethod())), CsvOf(RunQuietly(request, PaperMethod())));
}

TEST(Pipeline, ScoresClustersOnlyIfAskedToOrByTheirMethod) {
  const TemporaryFolder folder;
  WriteFlight(folder, "frames");
  PipelineRequest request;
  request.sources = {{"", folder / "frames"}};
  EXPECT_FALSE(RunQuietly(request, PaperMethod()).clusters.empty());
  EXPECT_TRUE(RunQuietly(request, Config()).clusters.empty());
  request.score_clusters = true;
  EXPECT_EQ(RunQuietly(request, Config()).clusters.size(),
            RunQuietly(request, PaperMethod()).clusters.size());
}

TEST(Pipeline, HandsOnWhatTheRobustMethodCounted) {
  const TemporaryFolder folder;
  WriteFlight(folder, "frames");
  PipelineRequest request;
  request.sources = {{"", folder / "frames"}};
  EXPECT_FALSE(RunQuietly(request, PaperMethod()).robust_counts.has_value());
  const PipelineResult result = RunQuietly(request, Config());
  const Recording recording = ReadRecording(request.sources, InputConfig(), {});
  const RobustCounts counts =
      FindTargetsRobust(recording, RobustConfig(), TrajectoryConfig()).counts;
  ASSERT_TRUE(result.robust_counts.has_value());
  EXPECT_GT(result.robust_counts->plots, 0U);
  EXPECT_EQ(result.robust_counts->plots, counts.plots);
  EXPECT_EQ(result.robust_counts->score_threshold, counts.score_threshold);
}

TEST(Pipeline, TellsEachStageOnceAndInOrder) {
  const TemporaryFolder folder;
  WriteFlight(folder, "frames");
  PipelineRequest request;
  request.sources = {{"", folder / "frames"}};
  std::vector<std::string> told;
  const PipelineResult result =
      RunPipeline(request, PaperMethod(), [&](const StageTime& time, const std::string& found) {
        told.push_back(time.stage + ": " + found);
      });
  EXPECT_EQ(told, (std::vector<std::string>{"read: 40 frames, 8240 returns", "targets: 1 target",
                                            "trajectories: 1 track"}));
  EXPECT_EQ(result.times.size(), told.size());
}

// In the middle of each of these frames.
std::vector<Measurement> SeenInFrames(const std::vector<int>& frames) {
  std::vector<Measurement> measurements(frames.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    measurements[i].time_ns = frames[i] * kPeriodNs + kPeriodNs / 2;
  }
  return measurements;
}

std::vector<int> EveryNth(int n, int from, int count) {
  std::vector<int> frames;
  for (int i = 0; i < count; ++i) frames.push_back(from + n * i);
  return frames;
}

// The most frames in a row in which nothing is seen with at least this probability.
int LongestLikelySilence(double seen_per_frame, double probability) {
  int frames = 0;
  for (double silence = 1.0 - seen_per_frame; silence >= probability;
       silence *= 1.0 - seen_per_frame) {
    ++frames;
  }
  return frames;
}

void ExpectFrames(const TimeInterval& interval, int first, int last) {
  EXPECT_EQ(interval.begin_ns, first * kPeriodNs);
  EXPECT_EQ(interval.end_ns, (last + 1) * kPeriodNs);
}

const Recording kHundredFrames = FramesOf(std::vector<std::uint32_t>(100, 1));

TEST(ExistenceInterval, OfATargetSeenInEveryFrameIsItsFirstAndLastFrame) {
  ExpectFrames(ExistenceInterval(kHundredFrames, SeenInFrames(EveryNth(1, 40, 20)), 0.05), 40, 59);
  ExpectFrames(ExistenceInterval(kHundredFrames, SeenInFrames({7}), 0.05), 7, 7);
}

TEST(ExistenceInterval, GoesOnThroughALikelySilence) {
  for (const int n : {2, 3, 5}) {
    const std::vector<Measurement> seen = SeenInFrames(EveryNth(n, 40, 6));
    for (const double probability : {0.3, 0.04, 0.011}) {
      const int silence = LongestLikelySilence(1.0 / n, probability);
      ExpectFrames(ExistenceInterval(kHundredFrames, seen, probability), 40 - silence,
                   40 + 5 * n + silence);
    }
    ExpectFrames(ExistenceInterval(kHundredFrames, seen, 1.0), 40, 40 + 5 * n);
  }
}

TEST(ExistenceInterval, EachEndHasTheSilenceOfItsOwnMeasurements) {
  std::vector<int> frames = EveryNth(1, 20, 20);
  const std::vector<int> sparse = EveryNth(4, 43, 9);
  frames.insert(frames.end(), sparse.begin(), sparse.end());
  ExpectFrames(ExistenceInterval(kHundredFrames, SeenInFrames(frames), 0.05), 20,
               sparse.back() + LongestLikelySilence(0.25, 0.05));
}

TEST(ExistenceInterval, OneOcclusionSaysNothingOfHowOftenATargetIsSeen) {
  ExpectFrames(ExistenceInterval(kHundredFrames, SeenInFrames({30, 31, 32, 52, 53}), 0.05), 30, 53);
}

TEST(ExistenceInterval, OfPausesOfDecadesDoesNotOverflow) {
  constexpr TimeNs kDecadesNs = 1'900'000'000 * kSecond;
  Recording recording = FramesOf({1, 1, 1, 1, 1});
  std::vector<Measurement> seen(recording.frames.size());
  for (std::size_t i = 0; i < seen.size(); ++i) {
    FrameInfo& frame = recording.frames[i];
    frame.stamp_ns = frame.begin_ns = (static_cast<TimeNs>(i) - 2) * kDecadesNs;
    frame.end_ns = frame.begin_ns + kPeriodNs;
    seen[i].time_ns = frame.begin_ns + kPeriodNs / 2;
  }
  const TimeInterval interval = ExistenceInterval(recording, seen, 1e-6);
  EXPECT_EQ(interval.begin_ns, recording.frames.front().begin_ns);
  EXPECT_EQ(interval.end_ns, recording.frames.back().end_ns);
}

TEST(ExistenceInterval, EndsWithTheRecording) {
  const Recording recording = FramesOf(std::vector<std::uint32_t>(30, 1));
  ExpectFrames(ExistenceInterval(recording, SeenInFrames(EveryNth(5, 2, 6)), 0.05), 0, 29);
}

TEST(ExistenceInterval, IsWidenedToTheFramesOfAnySensor) {
  Recording recording = FramesOf({1, 1, 1, 1});
  recording.sensors.push_back(recording.sensors.front());
  FrameInfo frame = recording.frames[1];
  frame.sensor = 1;
  frame.begin_ns -= kPeriodNs / 2;  // holds the middle of the first frame, too
  frame.end_ns = 3 * kPeriodNs + kPeriodNs / 2 + 1;
  frame.first_return = frame.last_return = recording.frames[1].last_return;
  recording.frames.insert(recording.frames.begin() + 2, frame);
  const TimeInterval interval = ExistenceInterval(recording, SeenInFrames({1, 2, 3}), 0.05);
  EXPECT_EQ(interval.begin_ns, kPeriodNs / 2);
  EXPECT_EQ(interval.end_ns, 4 * kPeriodNs);
}

std::vector<TrajectoryRow> Sampled(const RowSource& source, const std::vector<TimeNs>& times_ns) {
  const OutputInstants instants(times_ns);
  return Drained([rows = RowSampler(source, instants)]() mutable { return rows.Next(); });
}

// Of a straight flight, without limits.
RowSource SourceOf(const TimeInterval& presence) {
  RowSource source;
  source.trajectory = FitTrajectory(Straight(20), TrajectoryConfig());
  source.presence = presence;
  source.max_sigma_m = 1e3;
  return source;
}

TEST(RowSampler, GivesRowsInsideThePresenceAndTheSigmaLimit) {
  std::vector<TimeNs> times_ns(100);
  for (std::size_t i = 0; i < times_ns.size(); ++i) {
    times_ns[i] = (static_cast<TimeNs>(i) - 40) * kPeriodNs;
  }
  RowSource source = SourceOf({0, 5 * kPeriodNs});
  source.track_id = 3;
  const auto rows = Sampled(source, times_ns);
  ASSERT_EQ(rows.size(), 6U);
  EXPECT_EQ(rows.front().time_ns, 0);
  EXPECT_EQ(rows.back().time_ns, 5 * kPeriodNs);
  for (const TrajectoryRow& row : rows) EXPECT_EQ(row.track_id, 3);
  source.max_sigma_m = 1e-9;
  EXPECT_TRUE(Sampled(source, times_ns).empty());
  EXPECT_TRUE(Sampled(SourceOf({1, 2}), times_ns).empty());
  EXPECT_TRUE(Sampled(SourceOf({0, 5 * kPeriodNs}), {}).empty());
}

TEST(RowSampler, AllRowsShareAnErrorOfDepthAlongTheRay) {
  constexpr double kDepthSigma_m = 0.2;
  const std::vector<TimeNs> times_ns = {2 * kPeriodNs, 10 * kPeriodNs};
  RowSource source = SourceOf({kPeriodNs, 19 * kPeriodNs});
  const auto plain = Sampled(source, times_ns);
  source.common_errors.depth_sigma_m = kDepthSigma_m;
  const auto rows = Sampled(source, times_ns);
  ASSERT_EQ(rows.size(), 2U);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].position_m, plain[i].position_m);
    // The flight leads straight away from the origin, along (0.6, 0.8, 0).
    const Eigen::Vector3d added_m2 = rows[i].sigma_m.cwiseAbs2() - plain[i].sigma_m.cwiseAbs2();
    EXPECT_LT((added_m2 - Eigen::Vector3d(0.0144, 0.0256, 0.0)).norm(), 1e-3);
  }
  // It counts against the limit.
  source.max_sigma_m = 0.15;
  EXPECT_TRUE(Sampled(source, times_ns).empty());
  source.common_errors.depth_sigma_m = 0.0;
  EXPECT_EQ(Sampled(source, times_ns).size(), 2U);
}

TEST(RowSampler, AllRowsShareAnErrorOfElevationAcrossTheRay) {
  const std::vector<TimeNs> times_ns = {2 * kPeriodNs, 10 * kPeriodNs};
  RowSource source = SourceOf({kPeriodNs, 19 * kPeriodNs});
  source.viewpoints = {{0, Eigen::Vector3d(0.0, 0.0, -1000.0)}};
  const auto plain = Sampled(source, times_ns);
  source.common_errors.elevation_sigma_m = 0.2;
  source.viewpoints = {};  // at the height of the flight: upwards
  const auto level = Sampled(source, times_ns);
  source.viewpoints = {{0, plain[0].position_m - Eigen::Vector3d(0.0, 1.0, 1.0)}};
  const auto steep = Sampled(source, {times_ns[0]});
  ASSERT_EQ(level.size(), 2U);
  for (std::size_t i = 0; i < level.size(); ++i) {
    const Eigen::Vector3d added_m2 = level[i].sigma_m.cwiseAbs2() - plain[i].sigma_m.cwiseAbs2();
    EXPECT_LT((added_m2 - Eigen::Vector3d(0.0, 0.0, 0.04)).norm(), 1e-3);
  }
  const Eigen::Vector3d added_m2 = steep[0].sigma_m.cwiseAbs2() - plain[0].sigma_m.cwiseAbs2();
  EXPECT_LT((added_m2 - Eigen::Vector3d(0.0, 0.02, 0.02)).norm(), 1e-3);
}

TEST(RowSampler, AllRowsShareAnErrorOfTheTimesAlongTheWay) {
  const std::vector<TimeNs> times_ns = {2 * kPeriodNs, 10 * kPeriodNs};
  RowSource source = SourceOf({kPeriodNs, 19 * kPeriodNs});
  const auto plain = Sampled(source, times_ns);
  source.common_errors.time_sigma_s = 0.02;
  const auto rows = Sampled(source, times_ns);
  ASSERT_EQ(rows.size(), 2U);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].position_m, plain[i].position_m);
    const Eigen::Vector3d added_m2 = rows[i].sigma_m.cwiseAbs2() - plain[i].sigma_m.cwiseAbs2();
    EXPECT_LT((added_m2 - 0.0004 * rows[i].velocity_mps.cwiseAbs2()).norm(), 1e-12);
    EXPECT_GT(added_m2.norm(), 1e-5);
  }
}

// Of what is elsewhere with some probability, as much lies within so many sigmas of a row as of any
// other; what is hardly likely changes little, however far away it is.
TEST(RowSampler, SigmasHoldWhatIsDoubtedAsWell) {
  const std::vector<TimeNs> times_ns = {10 * kPeriodNs};
  RowSource source = SourceOf({0, 19 * kPeriodNs});
  const TrajectoryRow plain = Sampled(source, times_ns).front();
  constexpr double kOtherSigma_m = 0.3;
  for (const double probability : {0.005, 0.02, 0.2, 0.8}) {
    const Eigen::Vector3d offset_m(5.0, -0.1, 0.0);
    const AlternativeMode mode{times_ns[0], probability, plain.position_m + offset_m,
                               Eigen::Vector3d::Constant(kOtherSigma_m * kOtherSigma_m)};
    source.covariance_inflations = CovarianceInflationsOf({mode}, source.trajectory);
    const TrajectoryRow row = Sampled(source, times_ns).front();
    EXPECT_EQ(row.position_m, plain.position_m);
    for (int axis = 0; axis < 3; ++axis) {
      testing::Random random(7);
      int num_within = 0;
      constexpr int kDraws = 20000;
      for (int k = 0; k < kDraws; ++k) {
        const bool is_elsewhere = random.Uniform(0.0, 1.0) < probability;
        const double error_m = is_elsewhere ? offset_m[axis] + random.Normal(kOtherSigma_m)
                                            : random.Normal(plain.sigma_m[axis]);
        if (std::abs(error_m) < 2.575829 * row.sigma_m[axis]) ++num_within;
      }
      EXPECT_NEAR(num_within, 0.99 * kDraws, 0.005 * kDraws) << probability << ' ' << axis;
    }
    EXPECT_EQ(row.sigma_m.x() > 1.0, probability > 0.01);
  }
  // It counts against the limit.
  source.max_sigma_m = 1.0;
  EXPECT_TRUE(Sampled(source, times_ns).empty());
  source.covariance_inflations = CovarianceInflationsOf({{times_ns[0]}}, source.trajectory);
  EXPECT_EQ(Sampled(source, times_ns).front().sigma_m, plain.sigma_m);
}

TEST(RowSampler, BetweenTwoDoubtsSigmasChangeGradually) {
  RowSource source = SourceOf({0, 19 * kPeriodNs});
  source.covariance_inflations = {{4 * kPeriodNs, Eigen::Vector3d::Zero()},
                                  {8 * kPeriodNs, Eigen::Vector3d::Ones()}};
  const std::vector<TimeNs> times_ns = {3 * kPeriodNs, 5 * kPeriodNs, 9 * kPeriodNs};
  const auto rows = Sampled(source, times_ns);
  source.covariance_inflations.clear();
  const auto plain = Sampled(source, times_ns);
  constexpr std::array<double, 3> kAdded_m2 = {0.0, 0.25, 1.0};
  for (std::size_t i = 0; i < kAdded_m2.size(); ++i) {
    const Eigen::Vector3d added_m2 = rows[i].sigma_m.cwiseAbs2() - plain[i].sigma_m.cwiseAbs2();
    EXPECT_LT((added_m2.array() - kAdded_m2.at(i)).abs().maxCoeff(), 1e-9) << i;
  }
}

TEST(RowSampler, TheRayOfARowBeginsWhereItsNearestMeasurementWasSeenFrom) {
  const std::vector<TimeNs> times_ns = {2 * kPeriodNs, 10 * kPeriodNs};
  RowSource source = SourceOf({kPeriodNs, 19 * kPeriodNs});
  const auto plain = Sampled(source, times_ns);
  source.common_errors.depth_sigma_m = 0.2;
  source.viewpoints = {
      {0, {0.0, 0.0, -1000.0}}, {5 * kPeriodNs, {-1000.0, 0.0, 0.0}}, {20 * kPeriodNs, {0, 0, 0}}};
  const auto rows = Sampled(source, times_ns);
  ASSERT_EQ(rows.size(), 2U);
  const std::vector<Eigen::Vector3d> expected_m2 = {{0.0, 0.0, 0.04}, {0.04, 0.0, 0.0}};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Eigen::Vector3d added_m2 = rows[i].sigma_m.cwiseAbs2() - plain[i].sigma_m.cwiseAbs2();
    EXPECT_LT((added_m2 - expected_m2[i]).norm(), 2e-3) << i;
  }
}

TEST(SupportByFrame, CountsTheReturnsOfEachFrameThatHasOne) {
  const Recording recording = FramesOf({2, 3, 0, 5, 1});
  const auto support = SupportByFrame(recording, {1, 2, 4, 9, 10});
  ASSERT_EQ(support.size(), 4U);
  const std::pair<TimeNs, int> expected[] = {{0, 1}, {1, 2}, {3, 1}, {4, 1}};
  for (std::size_t i = 0; i < support.size(); ++i) {
    EXPECT_EQ(support[i].stamp_ns, expected[i].first * kPeriodNs);
    EXPECT_EQ(support[i].returns, expected[i].second);
  }
  EXPECT_TRUE(SupportByFrame(recording, {}).empty());
}

std::vector<int> SupportOf(const RowSource& source, const std::vector<TimeNs>& times_ns) {
  std::vector<int> support;
  for (const TrajectoryRow& row : Sampled(source, times_ns)) support.push_back(row.support);
  return support;
}

TEST(RowSampler, EachReturnSupportsTheRowNearestToItsFramesStamp) {
  RowSource source = SourceOf({0, 10 * kPeriodNs});
  source.support = {{0, 2}, {kPeriodNs, 3}, {3 * kPeriodNs, 5}, {4 * kPeriodNs, 1}};
  // The second frame is as near to the first row as to the second.
  EXPECT_EQ(SupportOf(source, {0, 2 * kPeriodNs, 3 * kPeriodNs}), (std::vector<int>{5, 0, 6}));
  EXPECT_EQ(SupportOf(source, {2 * kPeriodNs}), (std::vector<int>{11}));
  EXPECT_EQ(SupportOf(source, {5 * kPeriodNs, 6 * kPeriodNs}), (std::vector<int>{11, 0}));
}

// The rule by itself, for each return.
std::vector<int> NearestRows(const std::vector<TrajectoryRow>& rows,
                             const std::vector<FrameSupport>& support) {
  std::vector<int> counts(rows.size());
  for (const FrameSupport& frame : support) {
    const auto nearest =
        std::min_element(rows.begin(), rows.end(), [&](const auto& a, const auto& b) {
          return std::abs(a.time_ns - frame.stamp_ns) < std::abs(b.time_ns - frame.stamp_ns);
        });
    if (nearest != rows.end()) {
      counts[static_cast<std::size_t>(nearest - rows.begin())] += frame.returns;
    }
  }
  return counts;
}

TEST(RowSampler, NoReturnIsLostOrCountedTwice) {
  testing::Random random(7);
  for (int trial = 0; trial < testing::Draws(200); ++trial) {
    RowSource source = SourceOf({0, 1000});
    std::vector<TimeNs> times_ns(random.Index(30));
    for (TimeNs& time_ns : times_ns) time_ns = random.Index(1100);
    std::sort(times_ns.begin(), times_ns.end());
    times_ns.erase(std::unique(times_ns.begin(), times_ns.end()), times_ns.end());
    source.support.resize(random.Index(30));
    for (FrameSupport& frame : source.support) {
      frame = {static_cast<TimeNs>(random.Index(1100)), static_cast<int>(random.Index(5))};
    }
    std::sort(source.support.begin(), source.support.end(),
              [](const auto& a, const auto& b) { return a.stamp_ns < b.stamp_ns; });
    EXPECT_EQ(SupportOf(source, times_ns), NearestRows(Sampled(source, times_ns), source.support));
  }
}

TEST(PathLength, OfAStraightFlightIsItsLength) {
  EXPECT_NEAR(PathLength(FitTrajectory(Straight(20), TrajectoryConfig())), 19 * 0.5, 0.01);
  EXPECT_EQ(PathLength(FitTrajectory(Straight(1), TrajectoryConfig())), 0.0);
}

}  // namespace
}  // namespace unlidar
