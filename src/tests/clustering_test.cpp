// The clustering against its oracles: PCL, brute force, and each engine against the other.
// scikit-learn is the oracle of python_tests/test_clustering_sklearn.py.
#include "paper/clustering.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "pcl/pcl_clustering.hpp"
#include "tests/draws.hpp"
#include "tests/real_frames.hpp"

namespace unlidar {
namespace {

using Points = std::vector<Eigen::Vector3f>;
using Labels = std::vector<std::int32_t>;

ClusteringConfig Config(ClusterMethod method, ClusterEngine engine, double tolerance_m,
                        int min_neighbours = 5) {
  ClusteringConfig config;
  config.method = method;
  config.engine = engine;
  config.tolerance_m = tolerance_m;
  config.min_neighbours = min_neighbours;
  return config;
}

Labels EuclideanGrid(const Points& points_m, double tolerance_m) {
  return Cluster(points_m, Config(ClusterMethod::kEuclidean, ClusterEngine::kGrid, tolerance_m))
      .labels;
}

Labels EuclideanPcl(const Points& points_m, double tolerance_m) {
  UsePclClustering();
  return Cluster(points_m, Config(ClusterMethod::kEuclidean, ClusterEngine::kPcl, tolerance_m))
      .labels;
}

Labels DbscanGrid(const Points& points_m, double tolerance_m, int min_neighbours) {
  return Cluster(points_m,
                 Config(ClusterMethod::kDbscan, ClusterEngine::kGrid, tolerance_m, min_neighbours))
      .labels;
}

Labels DbscanPcl(const Points& points_m, double tolerance_m, int min_neighbours) {
  UsePclClustering();
  return Cluster(points_m,
                 Config(ClusterMethod::kDbscan, ClusterEngine::kPcl, tolerance_m, min_neighbours))
      .labels;
}

bool NearEuclidean(const Eigen::Vector3f& a, const Eigen::Vector3f& b, double tolerance_m) {
  const float dx = a.x() - b.x(), dy = a.y() - b.y(), dz = a.z() - b.z();
  const double radius_m = static_cast<float>(tolerance_m);
  return dx * dx + dy * dy + dz * dz < static_cast<float>(radius_m * radius_m);
}

bool NearDbscan(const Eigen::Vector3f& a, const Eigen::Vector3f& b, double tolerance_m) {
  const Eigen::Vector3d d = a.cast<double>() - b.cast<double>();
  return d.x() * d.x() + d.y() * d.y() + d.z() * d.z() <= tolerance_m * tolerance_m;
}

// DBSCAN by its definition: all pairs, then a walk from each core point in turn.
template <typename Near>
Labels BruteForce(const Points& points_m, double tolerance_m, std::size_t min_neighbours,
                  Near near) {
  std::vector<std::vector<std::size_t>> neighbours(points_m.size());
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    for (std::size_t j = 0; j < points_m.size(); ++j) {
      if (near(points_m[i], points_m[j], tolerance_m)) neighbours[i].push_back(j);
    }
  }
  Labels labels(points_m.size(), kNoise);
  std::int32_t next = 0;
  for (std::size_t seed = 0; seed < points_m.size(); ++seed) {
    if (labels[seed] != kNoise || neighbours[seed].size() < min_neighbours) continue;
    std::vector<std::size_t> stack = {seed};
    labels[seed] = next;
    while (!stack.empty()) {
      const std::size_t i = stack.back();
      stack.pop_back();
      if (neighbours[i].size() < min_neighbours) continue;
      for (const std::size_t j : neighbours[i]) {
        if (labels[j] != kNoise) continue;
        labels[j] = next;
        stack.push_back(j);
      }
    }
    ++next;
  }
  return labels;
}

void ExpectAllAgree(const Points& points_m, double tolerance_m) {
  const Labels euclidean = BruteForce(points_m, tolerance_m, 1, NearEuclidean);
  EXPECT_EQ(EuclideanGrid(points_m, tolerance_m), euclidean);
  EXPECT_EQ(EuclideanPcl(points_m, tolerance_m), euclidean);
  for (const int min_neighbours : {1, 2, 5, 12}) {
    const Labels dbscan =
        BruteForce(points_m, tolerance_m, static_cast<std::size_t>(min_neighbours), NearDbscan);
    EXPECT_EQ(DbscanGrid(points_m, tolerance_m, min_neighbours), dbscan) << min_neighbours;
    EXPECT_EQ(DbscanPcl(points_m, tolerance_m, min_neighbours), dbscan) << min_neighbours;
  }
}

Points RandomCloud(unsigned seed, std::size_t size, float half_width_m) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> coordinate_m(-half_width_m, half_width_m);
  Points points_m(size);
  for (Eigen::Vector3f& p : points_m) {
    p = {coordinate_m(generator), coordinate_m(generator), coordinate_m(generator)};
  }
  return points_m;
}

// Points on a lattice, many of them exactly one tolerance apart, some twice, in random order.
Points LatticeCloud(unsigned seed, std::size_t size, int cells, float step_m, float origin_m) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<int> cell(0, cells);
  Points points_m(size);
  for (Eigen::Vector3f& p : points_m) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      p[axis] = origin_m + step_m * static_cast<float>(cell(generator));
    }
  }
  return points_m;
}

TEST(Clustering, NoPointsMakeNoCluster) {
  UsePclClustering();
  for (const auto engine : {ClusterEngine::kGrid, ClusterEngine::kPcl}) {
    for (const auto method : {ClusterMethod::kEuclidean, ClusterMethod::kDbscan}) {
      const Clustering result = Cluster({}, Config(method, engine, 0.5));
      EXPECT_EQ(result.num_clusters, 0);
      EXPECT_TRUE(result.labels.empty());
    }
  }
}

TEST(Clustering, OnePointIsAEuclideanClusterAndDbscanNoise) {
  const Points one = {{1.0F, 2.0F, 3.0F}};
  EXPECT_EQ(EuclideanGrid(one, 0.5), Labels{0});
  EXPECT_EQ(EuclideanPcl(one, 0.5), Labels{0});
  EXPECT_EQ(DbscanGrid(one, 0.5, 1), Labels{0});
  EXPECT_EQ(DbscanGrid(one, 0.5, 2), Labels{kNoise});
  EXPECT_EQ(DbscanPcl(one, 0.5, 2), Labels{kNoise});
}

TEST(Clustering, TheBoundaryIsOutsideForPclAndInsideForScikitLearn) {
  const Points apart = {{0.0F, 0.0F, 0.0F}, {0.5F, 0.0F, 0.0F}};
  EXPECT_EQ(EuclideanGrid(apart, 0.5), (Labels{0, 1}));
  EXPECT_EQ(DbscanGrid(apart, 0.5, 2), (Labels{0, 0}));
  const Points nearer = {{0.0F, 0.0F, 0.0F}, {std::nextafter(0.5F, 0.0F), 0.0F, 0.0F}};
  EXPECT_EQ(EuclideanGrid(nearer, 0.5), (Labels{0, 0}));
  const Points farther = {{0.0F, 0.0F, 0.0F}, {std::nextafter(0.5F, 1.0F), 0.0F, 0.0F}};
  EXPECT_EQ(DbscanGrid(farther, 0.5, 2), (Labels{kNoise, kNoise}));
}

TEST(Clustering, DuplicatesBelongTogether) {
  Points points_m(50, Eigen::Vector3f(7.0F, -3.0F, 0.1F));
  points_m.resize(100, Eigen::Vector3f(-7.0F, 3.0F, 0.1F));
  ExpectAllAgree(points_m, 0.5);
}

TEST(Clustering, ABorderPointGoesToTheClusterOfTheLowestCoreIndex) {
  // Two bars of three core points, and between them, first in the list, a point both reach.
  const Points points_m = {{0.0F, 0.0F, 0.0F},  {1.0F, 0.0F, 0.0F},  {1.5F, 0.0F, 0.0F},
                           {1.5F, 0.1F, 0.0F},  {-1.0F, 0.0F, 0.0F}, {-1.5F, 0.0F, 0.0F},
                           {-1.5F, 0.1F, 0.0F}, {1.5F, 0.2F, 0.0F},  {-1.5F, 0.2F, 0.0F}};
  EXPECT_EQ(DbscanGrid(points_m, 1.0, 4), (Labels{0, 0, 0, 0, 1, 1, 1, 0, 1}));
  ExpectAllAgree(points_m, 1.0);
  Points mirrored = points_m;
  for (Eigen::Vector3f& p : mirrored) p.x() = -p.x();
  EXPECT_EQ(DbscanGrid(mirrored, 1.0, 4), (Labels{0, 0, 0, 0, 1, 1, 1, 0, 1}));
}

TEST(Clustering, BothEnginesAgreeWithBruteForceOnRandomClouds) {
  for (unsigned seed = 1; seed <= 12; ++seed) {
    for (const float half_width_m : {0.5F, 2.0F, 5.0F, 60.0F}) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << " width " << half_width_m);
      ExpectAllAgree(RandomCloud(seed, 300, half_width_m), 0.1 + 0.07 * seed);
    }
  }
}

// Lattice steps that floats hold exactly, so that no rounding hides a wrong comparison.
TEST(Clustering, BothEnginesAgreeWithBruteForceWhereManyDistancesAreExactlyTheTolerance) {
  for (unsigned seed = 1; seed <= testing::Draws(8U); ++seed) {
    for (const int cells : {3, 8, 20}) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << " cells " << cells);
      ExpectAllAgree(LatticeCloud(seed, 300, cells, 0.5F, -4.0F), 0.5);
      ExpectAllAgree(LatticeCloud(seed, 300, cells, 0.25F, 100.0F), 0.75);
      ExpectAllAgree(LatticeCloud(seed, 300, cells, 0.75F, 0.0F), 3.0 * 0.75);
    }
  }
}

// Steps that floats round: distances scatter by single units in the last place around the
// tolerance, where one rounding more or less would decide.
TEST(Clustering, BothEnginesRoundAlikeAtTheBoundary) {
  for (unsigned seed = 1; seed <= testing::Draws(8U); ++seed) {
    for (const float origin_m : {0.0F, -0.7F, 33.3F, -412.9F}) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << " origin " << origin_m);
      ExpectAllAgree(LatticeCloud(seed, 300, 8, 0.1F, origin_m), 0.1);
      ExpectAllAgree(LatticeCloud(seed, 300, 6, 0.3F, origin_m), 0.3);
    }
  }
}

// Each rounding of PCL and FLANN decides some of these pairs.
TEST(Clustering, PairsWithinARoundingOfTheToleranceAreJudgedAlike) {
  std::mt19937 generator(11);
  std::normal_distribution<double> component(0.0, 1.0);
  for (int k = 1; k <= 400; ++k) {
    const double tolerance_m = 0.013 * k;
    for (int i = 0; i < 25; ++i) {
      const Eigen::Vector3d direction(component(generator), component(generator),
                                      component(generator));
      const Points pair = {Eigen::Vector3f::Zero(),
                           (direction.normalized() * tolerance_m).cast<float>()};
      const Labels expected = BruteForce(pair, tolerance_m, 1, NearEuclidean);
      EXPECT_EQ(EuclideanGrid(pair, tolerance_m), expected) << tolerance_m;
      EXPECT_EQ(EuclideanPcl(pair, tolerance_m), expected) << tolerance_m;
      EXPECT_EQ(DbscanGrid(pair, tolerance_m, 2), BruteForce(pair, tolerance_m, 2, NearDbscan));
    }
  }
}

TEST(Clustering, OppositeCornersOfACellAreTestedToo) {
  for (const double tolerance_m : {0.1, 0.5, 2.0}) {
    for (double excess = 1e-5; excess < 0.1; excess *= 1.5) {
      const auto corner_m = static_cast<float>((1.0 + excess) * tolerance_m / std::sqrt(3.0));
      const Points pair = {Eigen::Vector3f::Zero(), Eigen::Vector3f::Constant(corner_m)};
      EXPECT_EQ(EuclideanGrid(pair, tolerance_m), (Labels{0, 1})) << excess;
      EXPECT_EQ(DbscanGrid(pair, tolerance_m, 2), (Labels{kNoise, kNoise})) << excess;
    }
  }
}

TEST(Clustering, HugeCoordinatesAreClusteredLikeAnyOther) {
  Points points_m = RandomCloud(3, 200, 2.0F);
  for (const float huge_m : {1e6F, 1e9F, 1e15F, 1e30F, 1e37F}) {
    for (const float sign : {-1.0F, 1.0F}) {
      points_m.insert(points_m.end(), 3, {sign * huge_m, 0.0F, 0.0F});
      points_m.insert(points_m.end(), 2, {0.0F, huge_m, sign * huge_m});
    }
  }
  ExpectAllAgree(points_m, 0.5);
}

TEST(Clustering, DistantGroupsKeepTheirShapeWhenTheGapBetweenThemIsClosedUp) {
  Points points_m;
  for (const float offset_m : {0.0F, 3e6F, 3.001e6F, -2e6F}) {
    for (Eigen::Vector3f p : LatticeCloud(5, 60, 8, 0.5F, 0.0F)) {
      p += Eigen::Vector3f::Constant(offset_m);
      points_m.push_back(p);
    }
  }
  ExpectAllAgree(points_m, 0.5);
  ExpectAllAgree(points_m, 0.8);
}

TEST(Clustering, PointsThatAreNotFiniteAreNoise) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kMax = std::numeric_limits<float>::max();
  const Points points_m = {{kNan, 0.0F, 0.0F},
                           {0.0F, 0.0F, 0.0F},
                           {0.0F, kInf, 0.0F},
                           {0.1F, 0.0F, 0.0F},
                           {0.0F, 0.0F, -kMax}};
  const Labels expected = {kNoise, 0, kNoise, 0, kNoise};
  EXPECT_EQ(EuclideanGrid(points_m, 0.5), expected);
  EXPECT_EQ(EuclideanPcl(points_m, 0.5), expected);
  EXPECT_EQ(DbscanGrid(points_m, 0.5, 2), expected);
}

TEST(Clustering, SmallClustersBecomeNoiseAndTheOthersKeepTheirOrder) {
  Points points_m = {{9.0F, 0.0F, 0.0F}};
  for (const float x_m : {0.0F, 20.0F}) {
    for (int i = 0; i < 3; ++i) points_m.push_back({x_m, 0.1F * static_cast<float>(i), 0.0F});
  }
  ClusteringConfig config = Config(ClusterMethod::kEuclidean, ClusterEngine::kGrid, 0.5);
  config.min_cluster_size = 3;
  const Clustering result = Cluster(points_m, config);
  EXPECT_EQ(result.num_clusters, 2);
  EXPECT_EQ(result.labels, (Labels{kNoise, 0, 0, 0, 1, 1, 1}));
}

// Real returns: scan patterns, duplicates, strays out to 430 m.
class RealFrames : public ::testing::Test {
 protected:
  void SetUp() override {
    frames_ = testing::ReadRealFrames(UNLIDAR_SOURCE_DIR, 11);
    if (frames_.empty()) GTEST_SKIP() << "no real recording beside the project";
  }
  std::vector<Points> frames_;
};

TEST_F(RealFrames, BothEnginesGiveTheSameLabelsForEachFrame) {
  for (const Points& frame : frames_) {
    for (const double tolerance_m : {0.2, 0.5, 1.0}) {
      EXPECT_EQ(EuclideanGrid(frame, tolerance_m), EuclideanPcl(frame, tolerance_m));
      EXPECT_EQ(DbscanGrid(frame, tolerance_m, 5), DbscanPcl(frame, tolerance_m, 5));
    }
  }
}

TEST_F(RealFrames, BothEnginesGiveTheSameLabelsForSuperimposedFrames) {
  const Points all = testing::Superimpose(frames_);
  for (const double tolerance_m : {0.1, 0.5}) {
    EXPECT_EQ(EuclideanGrid(all, tolerance_m), EuclideanPcl(all, tolerance_m));
    EXPECT_EQ(DbscanGrid(all, tolerance_m, 10), DbscanPcl(all, tolerance_m, 10));
  }
}

}  // namespace
}  // namespace unlidar
