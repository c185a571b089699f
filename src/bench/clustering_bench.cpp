// Speed of the clustering on the real Mid-360 recording, or on a random cloud where it is missing.
#include <benchmark/benchmark.h>

#include <random>

#include "paper/clustering.hpp"
#include "tests/real_frames.hpp"

namespace unlidar {
namespace {

using Points = std::vector<Eigen::Vector3f>;

Points RandomCloud(std::size_t size) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> coordinate_m(-30.0F, 30.0F);
  Points points_m(size);
  for (Eigen::Vector3f& p : points_m) {
    p = {coordinate_m(generator), coordinate_m(generator), 0.1F * coordinate_m(generator)};
  }
  return points_m;
}

const Points& OneFrame() {
  static const Points points_m = [] {
    const auto frames = testing::ReadRealFrames(UNLIDAR_SOURCE_DIR, 100);
    return frames.empty() ? RandomCloud(4'200) : frames[0];
  }();
  return points_m;
}

const Points& AllFrames() {
  static const Points points_m = [] {
    const Points all = testing::Superimpose(testing::ReadRealFrames(UNLIDAR_SOURCE_DIR, 1));
    return all.empty() ? RandomCloud(369'000) : all;
  }();
  return points_m;
}

void Run(benchmark::State& state, const Points& points_m, ClusterMethod method,
         ClusterEngine engine) {
  ClusteringConfig config;
  config.method = method;
  config.engine = engine;
  for (auto _ : state) benchmark::DoNotOptimize(Cluster(points_m, config));
  state.counters["points"] = static_cast<double>(points_m.size());
}

void BM_FrameEuclideanGrid(benchmark::State& state) {
  Run(state, OneFrame(), ClusterMethod::kEuclidean, ClusterEngine::kGrid);
}
void BM_FrameEuclideanPcl(benchmark::State& state) {
  Run(state, OneFrame(), ClusterMethod::kEuclidean, ClusterEngine::kPcl);
}
void BM_FrameDbscanGrid(benchmark::State& state) {
  Run(state, OneFrame(), ClusterMethod::kDbscan, ClusterEngine::kGrid);
}
void BM_AllFramesEuclideanGrid(benchmark::State& state) {
  Run(state, AllFrames(), ClusterMethod::kEuclidean, ClusterEngine::kGrid);
}
void BM_AllFramesEuclideanPcl(benchmark::State& state) {
  Run(state, AllFrames(), ClusterMethod::kEuclidean, ClusterEngine::kPcl);
}
void BM_AllFramesDbscanGrid(benchmark::State& state) {
  Run(state, AllFrames(), ClusterMethod::kDbscan, ClusterEngine::kGrid);
}

BENCHMARK(BM_FrameEuclideanGrid)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_FrameEuclideanPcl)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_FrameDbscanGrid)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_AllFramesEuclideanGrid)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_AllFramesEuclideanPcl)->Unit(benchmark::kMillisecond)->Iterations(1);
BENCHMARK(BM_AllFramesDbscanGrid)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace unlidar
