// Speed of the clustering, ours and PCL's by turns, on the frames of a folder: on the fullest of
// them and on all of them superimposed.
//   clustering_bench FRAMES_DIR [OPTION OF GOOGLE BENCHMARK...]
#include <benchmark/benchmark.h>

#include <algorithm>
#include <iostream>
#include <string>
#include <vector>

#include "io/frames.hpp"
#include "paper/clustering.hpp"
#include "pcl/pcl_clustering.hpp"
#include "tests/read_recording.hpp"

namespace unlidar {
namespace {

using Points = std::vector<Eigen::Vector3f>;

Points FullestFrame(const Recording& recording) {
  const auto size = [](const FrameInfo& frame) { return frame.last_return - frame.first_return; };
  const auto fullest =
      std::max_element(recording.frames.begin(), recording.frames.end(),
                       [&](const FrameInfo& a, const FrameInfo& b) { return size(a) < size(b); });
  return {recording.points_m.begin() + fullest->first_return,
          recording.points_m.begin() + fullest->last_return};
}

void Register(const std::string& name, const Points& points_m, ClusterMethod method,
              ClusterEngine engine) {
  const auto run = [&points_m, method, engine](benchmark::State& state) {
    ClusteringConfig config;
    config.method = method;
    config.engine = engine;
    std::int32_t clusters = 0;
    for ([[maybe_unused]] const auto iteration : state) {
      clusters = Cluster(points_m, config).num_clusters;
    }
    state.counters["returns"] = static_cast<double>(points_m.size());
    state.counters["clusters"] = clusters;
  };
  benchmark::RegisterBenchmark(name.c_str(), run)->Unit(benchmark::kMillisecond);
}

void RegisterAll(const std::string& name, const Points& points_m) {
  Register(name + "/euclidean/grid", points_m, ClusterMethod::kEuclidean, ClusterEngine::kGrid);
  Register(name + "/euclidean/pcl", points_m, ClusterMethod::kEuclidean, ClusterEngine::kPcl);
  Register(name + "/dbscan/grid", points_m, ClusterMethod::kDbscan, ClusterEngine::kGrid);
}

int Main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  UsePclClustering();
  if (argc != 2) {
    std::cerr << "usage: clustering_bench FRAMES_DIR [OPTION OF GOOGLE BENCHMARK...]\n";
    return 2;
  }
  const Recording recording = ReadRecording({{"frames", argv[1]}}, InputConfig(), {});
  const Points frame_m = FullestFrame(recording);
  RegisterAll("frame", frame_m);
  RegisterAll("all", recording.points_m);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}

}  // namespace
}  // namespace unlidar

int main(int argc, char** argv) { return unlidar::Main(argc, argv); }
