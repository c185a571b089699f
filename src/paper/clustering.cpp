#include "paper/clustering.hpp"

#include <cstddef>
#include <stdexcept>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

constexpr float kLargestCoordinateM = 1e37F;  // the sum of two is finite
constexpr std::size_t kMaxClusterPoints =
    700'000'000;  // three cells per point fit 31-bit cell numbers

void DropSmallClusters(int min_cluster_size, Clustering& result) {
  std::vector<std::int64_t> sizes(static_cast<std::size_t>(result.num_clusters), 0);
  for (const std::int32_t label : result.labels) {
    if (label != kNoise) ++sizes[static_cast<std::size_t>(label)];
  }
  std::vector<std::int32_t> new_labels(sizes.size(), kNoise);
  result.num_clusters = 0;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (sizes[i] >= min_cluster_size) new_labels[i] = result.num_clusters++;
  }
  for (std::int32_t& label : result.labels) {
    if (label != kNoise) label = new_labels[static_cast<std::size_t>(label)];
  }
}

}  // namespace

ClusterFunction& PclClustering() {
  static ClusterFunction function = nullptr;
  return function;
}

Clustering Cluster(const std::vector<Eigen::Vector3f>& points_m, const ClusteringConfig& config) {
  if (points_m.size() > kMaxClusterPoints)
    throw std::length_error("clustering: over 700 million points");
  std::vector<std::uint32_t> usable;
  usable.reserve(points_m.size());
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    // NaN fails this comparison.
    if ((points_m[i].array().abs() <= kLargestCoordinateM).all()) {
      usable.push_back(static_cast<std::uint32_t>(i));
    }
  }
  const auto run_engine = [&](const std::vector<Eigen::Vector3f>& usable_points_m) {
    if (usable_points_m.empty()) return Clustering{};
    Clustering result = config.engine == ClusterEngine::kGrid
                            ? ClusterByGrid(usable_points_m, config)
                            : PclClustering()(usable_points_m, config);
    if (config.min_cluster_size > 1) DropSmallClusters(config.min_cluster_size, result);
    return result;
  };
  if (usable.size() == points_m.size()) return run_engine(points_m);

  const Clustering usable_result = run_engine(ValuesAt(usable, points_m));
  Clustering result;
  result.num_clusters = usable_result.num_clusters;
  result.labels.assign(points_m.size(), kNoise);
  for (std::size_t i = 0; i < usable.size(); ++i)
    result.labels[usable[i]] = usable_result.labels[i];
  return result;
}

}  // namespace unlidar
