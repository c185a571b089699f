// The paper's equations on cases worked out by hand, and its method on small made-up recordings.
#include "paper/paper.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/algorithms.hpp"
#include "base/voxel_grid.hpp"
#include "tests/real_frames.hpp"

namespace unlidar {
namespace {

using Points = std::vector<Eigen::Vector3f>;

constexpr TimeNs kFramePeriodNs = 100'000'000;

Recording MakeRecording(const std::vector<Points>& frames) {
  Recording recording;
  recording.sensors.resize(1);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    FrameInfo info;
    info.stamp_ns = static_cast<TimeNs>(i) * kFramePeriodNs;
    info.begin_ns = info.stamp_ns;
    info.end_ns = info.stamp_ns + kFramePeriodNs;
    info.first_return = static_cast<std::uint32_t>(recording.points_m.size());
    for (const Eigen::Vector3f& p : frames[i]) {
      recording.points_m.push_back(p);
      recording.times_ns.push_back(info.stamp_ns + kFramePeriodNs / 2);
    }
    info.last_return = static_cast<std::uint32_t>(recording.points_m.size());
    recording.frames.push_back(info);
  }
  return recording;
}

// Clusters of every size, voxels of 1 m, to count on one's fingers.
PaperConfig SimpleConfig() {
  PaperConfig config;
  config.global_clusters = ClusteringConfig();
  config.global_clusters.tolerance_m = 1.5;
  config.local_clusters.tolerance_m = 1.5;
  config.voxel_size_m = 1.0;
  return config;
}

// The centres of a cube of 3 x 3 x 3 voxels of 1 m, its lowest corner at (x, y, z).
Points CubeAt(float x_m, float y_m, float z_m) {
  Points points_m;
  for (int i = 0; i < 27; ++i) {
    points_m.emplace_back(x_m + 0.5F + static_cast<float>(i % 3),
                          y_m + 0.5F + static_cast<float>(i / 3 % 3),
                          z_m + 0.5F + static_cast<float>(i / 9));
  }
  return points_m;
}

VoxelSet VoxelsOf(const Points& points_m, double size_m) {
  std::vector<VoxelKey> keys;
  for (const Eigen::Vector3f& p : points_m) keys.push_back(VoxelOf(p, size_m));
  return SortedUnique(keys);
}

void ExpectAllFinite(const ClusterScore& score) {
  for (const double value : {score.volume_m3, score.local_volume_m3, score.merged_density_per_m3,
                             score.local_density_per_m3, score.iou, score.relative_density,
                             score.psi_iou, score.psi_rho, score.psi, score.von_neumann_ratio}) {
    EXPECT_TRUE(std::isfinite(value)) << "cluster " << score.id;
  }
  EXPECT_TRUE(score.centroid_m.allFinite());
  EXPECT_TRUE(score.extent_m.allFinite());
}

TEST(VoxelGrid, ThreePointsInTwoVoxelsHaveTheVolumeAndDensityOfTwo) {
  const VoxelSet voxels =
      VoxelsOf({{0.1F, 0.1F, 0.1F}, {0.3F, 0.4F, 0.4F}, {0.6F, 0.1F, 0.1F}}, 0.5);
  EXPECT_EQ(voxels.size(), 2U);
  EXPECT_DOUBLE_EQ(VoxelVolumeM3(voxels.size(), 0.5), 0.25);
  EXPECT_DOUBLE_EQ(Density(3, 0.25), 12.0);
}

TEST(VoxelGrid, VoxelsAreHalfOpenAndDoNotFoldAtZero) {
  EXPECT_NE(VoxelOf({-0.1F, 0.0F, 0.0F}, 1.0), VoxelOf({0.1F, 0.0F, 0.0F}, 1.0));
  EXPECT_EQ(VoxelOf({0.0F, 0.0F, 0.0F}, 1.0), VoxelOf({0.99F, 0.5F, 0.0F}, 1.0));
  EXPECT_NE(VoxelOf({0.99F, 0.0F, 0.0F}, 1.0), VoxelOf({1.0F, 0.0F, 0.0F}, 1.0));
}

TEST(VoxelGrid, AbsurdCoordinatesFallIntoTheOutermostVoxels) {
  EXPECT_EQ(VoxelOf({1e30F, 0.0F, 0.0F}, 0.2), VoxelOf({1e25F, 0.0F, 0.0F}, 0.2));
  EXPECT_NE(VoxelOf({1e30F, 0.0F, 0.0F}, 0.2), VoxelOf({-1e30F, 0.0F, 0.0F}, 0.2));
  EXPECT_NE(VoxelOf({0.0F, 1e30F, 0.0F}, 0.2), VoxelOf({1e30F, 0.0F, 0.0F}, 0.2));
}

TEST(VoxelGrid, ACubeShiftedByOneOfItsThreeVoxelsSharesTwoThirdsOfEach) {
  const VoxelSet cube = VoxelsOf(CubeAt(0, 0, 0), 1.0);
  // 18 voxels shared, 27 + 27 - 18 = 36 in either.
  EXPECT_DOUBLE_EQ(VoxelIou(cube, VoxelsOf(CubeAt(1, 0, 0), 1.0)), 0.5);
  EXPECT_DOUBLE_EQ(VoxelIou(VoxelsOf(CubeAt(1, 0, 0), 1.0), cube), 0.5);
  EXPECT_DOUBLE_EQ(VoxelIou(cube, cube), 1.0);
  EXPECT_DOUBLE_EQ(VoxelIou(cube, VoxelsOf(CubeAt(3, 0, 0), 1.0)), 0.0);
  EXPECT_DOUBLE_EQ(VoxelIou({}, {}), 0.0);
}

TEST(PaperEquations, RelativeDensityHasThreeReadings) {
  EXPECT_DOUBLE_EQ(RelativeDensity(2.0, 8.0, DensityReading::kFrameOverMerged), 0.25);
  EXPECT_DOUBLE_EQ(RelativeDensity(2.0, 8.0, DensityReading::kMergedOverFrame), 4.0);
  EXPECT_DOUBLE_EQ(RelativeDensity(2.0, 8.0, DensityReading::kRelativeDifference), 0.75);
  EXPECT_DOUBLE_EQ(RelativeDensity(14.0, 8.0, DensityReading::kRelativeDifference), 0.75);
}

TEST(PaperEquations, DensitySummandIsTheExponentialOrRItselfAndStaysFinite) {
  EXPECT_DOUBLE_EQ(DensitySummand(2.0, DensityTerm::kExponential), std::exp(2.0));
  EXPECT_DOUBLE_EQ(DensitySummand(2.0, DensityTerm::kLinear), 2.0);
  EXPECT_TRUE(std::isfinite(1e6 * DensitySummand(1e9, DensityTerm::kExponential)));
}

TEST(PaperEquations, IouSummandFallsWithTheOverlapAndIsFiniteWithoutAny) {
  EXPECT_DOUBLE_EQ(IouSummand(1.0, IouTerm::kLogarithm, 0.01), 0.0);
  EXPECT_DOUBLE_EQ(IouSummand(0.5, IouTerm::kLogarithm, 0.01), std::log(2.0));
  EXPECT_DOUBLE_EQ(IouSummand(0.0, IouTerm::kLogarithm, 0.01), std::log(100.0));
  EXPECT_DOUBLE_EQ(IouSummand(1.0, IouTerm::kInverse, 0.01), 1.0);
  EXPECT_DOUBLE_EQ(IouSummand(0.0, IouTerm::kInverse, 0.01), 100.0);
  EXPECT_DOUBLE_EQ(IouSummand(0.25, IouTerm::kComplement, 0.01), 0.75);
  EXPECT_DOUBLE_EQ(IouSummand(0.0, IouTerm::kComplement, 0.01), 1.0);
}

TEST(PaperEquations, AccumulateIsTheMeanOrTheSumAndZeroOfNothing) {
  EXPECT_DOUBLE_EQ(Accumulate({1.0, 2.0, 6.0}, Accumulation::kMean), 3.0);
  EXPECT_DOUBLE_EQ(Accumulate({1.0, 2.0, 6.0}, Accumulation::kSum), 9.0);
  EXPECT_DOUBLE_EQ(Accumulate({}, Accumulation::kMean), 0.0);
  EXPECT_DOUBLE_EQ(Psi(2.0, 3.0, 0.5), 3.5);
}

TEST(PaperEquations, VonNeumannRatioIsTwoForWhiteJitterAndSmallForADrift) {
  std::mt19937 generator(7);
  std::normal_distribution<double> jitter_m(0.0, 0.3);
  std::vector<Eigen::Vector3d> white, drift;
  for (int i = 0; i < 2000; ++i) {
    white.emplace_back(jitter_m(generator), jitter_m(generator), jitter_m(generator));
    drift.emplace_back(0.1 * i, 0.0, 0.0);
  }
  EXPECT_NEAR(VonNeumannRatio(white), 2.0, 0.1);
  EXPECT_LT(VonNeumannRatio(drift), 1e-5);
  // 0, 1, 0: steps of 1 and 1, mean 1/3, spread 4/9 + 1/9 + 1/9 = 2/3.
  EXPECT_DOUBLE_EQ(VonNeumannRatio({{0, 0, 0}, {1, 0, 0}, {0, 0, 0}}), 3.0);
  EXPECT_DOUBLE_EQ(VonNeumannRatio({{0, 0, 0}, {5, 0, 0}}), 2.0);
  EXPECT_DOUBLE_EQ(VonNeumannRatio({{4, 4, 4}, {4, 4, 4}, {4, 4, 4}}), 2.0);
  EXPECT_DOUBLE_EQ(VonNeumannRatio({}), 2.0);
}

TEST(PaperScore, AStaticWallOverlapsFullyAndItsFramesAreThinnerThanAllTogether) {
  // 27 returns in the same 27 voxels in each of 4 frames.
  const Recording recording = MakeRecording(std::vector<Points>(4, CubeAt(0, 0, 0)));
  const std::vector<ClusterScore> scores = ScoreClusters(recording, SimpleConfig());
  ASSERT_EQ(scores.size(), 1U);
  const ClusterScore& wall = scores[0];
  EXPECT_EQ(wall.size, 108);
  EXPECT_EQ(wall.frames, 4);
  EXPECT_EQ(wall.windows, 4);
  EXPECT_EQ(wall.pairs, 3);
  EXPECT_EQ(wall.first_ns, 0);
  EXPECT_EQ(wall.last_ns, 3 * kFramePeriodNs);
  EXPECT_TRUE(wall.centroid_m.isApprox(Eigen::Vector3d(1.5, 1.5, 1.5)));
  EXPECT_TRUE(wall.extent_m.isApprox(Eigen::Vector3d(2, 2, 2)));
  EXPECT_DOUBLE_EQ(wall.volume_m3, 27.0);
  EXPECT_DOUBLE_EQ(wall.local_volume_m3, 27.0);
  EXPECT_DOUBLE_EQ(wall.merged_density_per_m3, 4.0);
  EXPECT_DOUBLE_EQ(wall.local_density_per_m3, 1.0);
  EXPECT_DOUBLE_EQ(wall.iou, 1.0);
  EXPECT_DOUBLE_EQ(wall.relative_density, 0.25);
  EXPECT_DOUBLE_EQ(wall.psi_iou, 0.0);
  EXPECT_DOUBLE_EQ(wall.psi_rho, std::exp(0.25));
  EXPECT_DOUBLE_EQ(wall.psi, std::exp(0.25));
}

TEST(PaperScore, ACubeThatMovesByItsSideIsAsDenseInAFrameAsInAllAndNeverOverlaps) {
  const Recording recording =
      MakeRecording({CubeAt(0, 0, 0), CubeAt(3, 0, 0), CubeAt(6, 0, 0), CubeAt(9, 0, 0)});
  const ClusterScore mover = ScoreClusters(recording, SimpleConfig()).at(0);
  EXPECT_DOUBLE_EQ(mover.iou, 0.0);
  EXPECT_DOUBLE_EQ(mover.relative_density, 1.0);
  EXPECT_DOUBLE_EQ(mover.psi_iou, std::log(100.0));
  EXPECT_DOUBLE_EQ(mover.psi_rho, std::exp(1.0));
  EXPECT_DOUBLE_EQ(mover.psi, std::exp(1.0) + std::log(100.0));
}

TEST(PaperScore, SumsGrowWithThePairsAndLambdaWeighsTheOverlap) {
  const Recording recording =
      MakeRecording({CubeAt(0, 0, 0), CubeAt(1, 0, 0), CubeAt(2, 0, 0), CubeAt(3, 0, 0)});
  PaperConfig config = SimpleConfig();
  config.accumulation = Accumulation::kSum;
  config.iou_term = IouTerm::kComplement;
  config.density_term = DensityTerm::kLinear;
  config.lambda = 10.0;
  const ClusterScore score = ScoreClusters(recording, config).at(0);
  // 54 voxels hold 108 returns: merged density 2, R = 1/2 in 4 windows; IoU 1/2 in 3 pairs.
  EXPECT_DOUBLE_EQ(score.psi_rho, 2.0);
  EXPECT_DOUBLE_EQ(score.psi_iou, 1.5);
  EXPECT_DOUBLE_EQ(score.psi, 17.0);
}

TEST(PaperScore, AWindowJoinsItsFrames) {
  const Recording recording =
      MakeRecording({CubeAt(0, 0, 0), CubeAt(1, 0, 0), CubeAt(2, 0, 0), CubeAt(3, 0, 0)});
  PaperConfig config = SimpleConfig();
  config.window_frames = 2;
  const ClusterScore score = ScoreClusters(recording, config).at(0);
  EXPECT_EQ(score.frames, 4);
  EXPECT_EQ(score.windows, 2);
  // Each window fills 4 x 3 x 3 voxels; they share 2 x 3 x 3 of 6 x 3 x 3.
  EXPECT_DOUBLE_EQ(score.local_volume_m3, 36.0);
  EXPECT_DOUBLE_EQ(score.iou, 18.0 / 54.0);
}

TEST(PaperScore, EmptyWindowsAreSkippedOrCountAsNoOverlap) {
  const Recording recording = MakeRecording({CubeAt(0, 0, 0), {}, {}, CubeAt(0, 0, 0)});
  PaperConfig config = SimpleConfig();
  ClusterScore score = ScoreClusters(recording, config).at(0);
  EXPECT_EQ(score.pairs, 1);
  EXPECT_DOUBLE_EQ(score.iou, 1.0);
  config.empty_windows = EmptyWindows::kZeroIou;
  score = ScoreClusters(recording, config).at(0);
  EXPECT_EQ(score.pairs, 2);
  EXPECT_DOUBLE_EQ(score.iou, 0.0);
}

TEST(PaperScore, TheLargestLocalClusterLeavesThePiecesThatOnlyTheMergedFramesConnect) {
  // In each frame the cluster falls into a piece of three and one of a single return.
  const Points one = {{0.5F, 0, 0}, {0.6F, 0, 0}, {1.5F, 0, 0}, {4.5F, 0, 0}};
  const Points two = {{2.5F, 0, 0}, {3.5F, 0, 0}};
  const Recording recording = MakeRecording({one, two, one});
  PaperConfig config = SimpleConfig();
  EXPECT_DOUBLE_EQ(ScoreClusters(recording, config).at(0).local_volume_m3, (3.0 + 2.0 + 3.0) / 3.0);
  config.local = LocalClusters::kLargestOfWindow;
  EXPECT_DOUBLE_EQ(ScoreClusters(recording, config).at(0).local_volume_m3, (2.0 + 2.0 + 2.0) / 3.0);
}

TEST(PaperMethod, AMoverBesideAStaticWallWinsAndIsMeasuredFrameByFrame) {
  std::vector<Points> frames;
  for (int i = 0; i < 5; ++i) {
    Points frame = CubeAt(0, 0, 0);
    const Points mover = CubeAt(20.0F + 2.0F * static_cast<float>(i), 0, 5);
    frame.insert(frame.end(), mover.begin(), mover.end());
    frames.push_back(frame);
  }
  const Recording recording = MakeRecording(frames);
  std::vector<ClusterScore> scores;
  const std::vector<Target> targets = FindTargetsPaper(recording, SimpleConfig(), &scores);
  ASSERT_EQ(scores.size(), 2U);
  EXPECT_EQ(scores[0].rank, 1);
  EXPECT_EQ(scores[1].rank, 2);
  EXPECT_GT(scores[0].centroid_m.x(), 20.0);
  ASSERT_EQ(targets.size(), 1U);
  EXPECT_DOUBLE_EQ(targets[0].score, scores[0].psi);
  EXPECT_EQ(targets[0].returns.size(), 5U * 27U);
  ASSERT_EQ(targets[0].measurements.size(), 5U);
  for (int i = 0; i < 5; ++i) {
    const Measurement& measurement = targets[0].measurements[static_cast<std::size_t>(i)];
    EXPECT_EQ(measurement.time_ns, i * kFramePeriodNs + kFramePeriodNs / 2);
    EXPECT_EQ(measurement.support, 27);
    EXPECT_TRUE(measurement.position_m.isApprox(Eigen::Vector3d(21.5 + 2.0 * i, 1.5, 6.5), 1e-6));
    // Three layers at -1, 0, 1 m: 18 per axis and frame over 130 degrees of freedom, plus noise.
    const double variance_m2 = (5.0 * 18.0 / 130.0 + 0.05 * 0.05) / 27.0;
    EXPECT_NEAR(measurement.covariance_m2(0, 0), variance_m2, 1e-9);
    EXPECT_NEAR(measurement.covariance_m2(0, 1), 0.0, 1e-9);
  }
}

TEST(PaperMethod, SingleReturnsHaveAnInvertibleCovariance) {
  const Recording recording = MakeRecording({{{0, 0, 5}}, {{1, 0, 5}}, {{2, 0, 5}}});
  const std::vector<Target> targets = FindTargetsPaper(recording, SimpleConfig());
  ASSERT_EQ(targets.size(), 1U);
  for (const Measurement& measurement : targets[0].measurements) {
    EXPECT_DOUBLE_EQ(measurement.covariance_m2(2, 2), 0.05 * 0.05);
  }
}

TEST(PaperMethod, WithoutAClusterOfTwoWindowsThereIsNoTarget) {
  EXPECT_TRUE(FindTargetsPaper(MakeRecording({}), SimpleConfig()).empty());
  EXPECT_TRUE(FindTargetsPaper(MakeRecording({{}, {}}), SimpleConfig()).empty());
  std::vector<ClusterScore> scores;
  const Recording once = MakeRecording({CubeAt(0, 0, 0), {}, CubeAt(50, 0, 0)});
  EXPECT_TRUE(FindTargetsPaper(once, SimpleConfig(), &scores).empty());
  EXPECT_EQ(scores.size(), 2U);
  for (const ClusterScore& score : scores) ExpectAllFinite(score);
}

TEST(PaperMethod, EveryNumberIsFiniteForEveryReadingAndAbsurdCoordinates) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> coordinate_m(-4.0F, 4.0F);
  std::vector<Points> frames(6);
  for (Points& frame : frames) {
    for (int i = 0; i < 100; ++i) {
      frame.emplace_back(coordinate_m(generator), coordinate_m(generator), coordinate_m(generator));
    }
    frame.insert(frame.end(), 5, {1e30F, -1e36F, 0.0F});
    frame.insert(frame.end(), 200, {50.0F, 0.0F, 0.0F});
  }
  frames[2].clear();
  const Recording recording = MakeRecording(frames);
  PaperConfig config = SimpleConfig();
  config.voxel_size_m = 0.01;
  for (const auto local : {LocalClusters::kShareOfGlobal, LocalClusters::kLargestOfWindow}) {
    for (const auto density : {DensityReading::kFrameOverMerged, DensityReading::kMergedOverFrame,
                               DensityReading::kRelativeDifference}) {
      for (const auto iou : {IouTerm::kLogarithm, IouTerm::kInverse, IouTerm::kComplement}) {
        for (const auto accumulation : {Accumulation::kMean, Accumulation::kSum}) {
          config.local = local;
          config.density_reading = density;
          config.iou_term = iou;
          config.accumulation = accumulation;
          for (const ClusterScore& score : ScoreClusters(recording, config)) ExpectAllFinite(score);
        }
      }
    }
  }
}

TEST(PaperMethod, OnTheRealRecordingEveryNumberIsFiniteAndTheOrderOfTimeTellsTheDrone) {
  const auto frames = testing::ReadRealFrames(UNLIDAR_SOURCE_DIR, 1);
  if (frames.empty()) GTEST_SKIP() << "no real recording beside the project";
  const auto scores = ScoreClusters(MakeRecording(frames), PaperConfig());
  ASSERT_GT(scores.size(), 100U);
  const ClusterScore* smoothest = &scores[0];
  for (const ClusterScore& score : scores) {
    ExpectAllFinite(score);
    if (score.von_neumann_ratio < smoothest->von_neumann_ratio) smoothest = &score;
  }
  // The drone hovers 2.4 m above the station and is seen in every frame.
  EXPECT_EQ(smoothest->frames, 88);
  EXPECT_LT(smoothest->von_neumann_ratio, 0.01);
  EXPECT_LT(smoothest->centroid_m.norm(), 3.0);
  EXPECT_GT(smoothest->centroid_m.z(), 1.0);
}

}  // namespace
}  // namespace unlidar
