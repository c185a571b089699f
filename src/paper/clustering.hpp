// Distance-based clustering, exactly as defined by PCL and scikit-learn.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "unlidar/config.hpp"

namespace unlidar {

inline constexpr std::int32_t kNoise = -1;

struct Clustering {
  std::vector<std::int32_t> labels;  // (N) kNoise or 0 ... num_clusters - 1, see Cluster()
  std::int32_t num_clusters = 0;
};

// Labels N points, in metres.
//
// kEuclidean is the partition of pcl::EuclideanClusterExtraction: connected components of the graph
// that joins two points if their squared distance, accumulated in float as in FLANN, is *below*
// float(tolerance)^2.
//
// kDbscan is sklearn.cluster.DBSCAN (Ester et al., KDD 1996) on the same coordinates as doubles:
// neighbours are at most `tolerance_m` apart, a point is its own neighbour, and a border point
// joins, of the clusters with a core point in reach, the one with the lowest core index.
//
// Clusters smaller than `min_cluster_size` are dropped; the others are numbered by lowest core
// index (every point of a Euclidean cluster is core), as in scikit-learn. Both engines return the
// same labels. Points that are not finite, or have a coordinate beyond 1e37 m, are noise.
Clustering Cluster(const std::vector<Eigen::Vector3f>& points_m, const ClusteringConfig& config);

// Labels finite points; clusters of any size are numbered by lowest core index.
using ClusterFunction = Clustering (*)(const std::vector<Eigen::Vector3f>& points_m,
                                       const ClusteringConfig& config);

// The engine `pcl`; null where it is not linked, see pcl/pcl_clustering.hpp. Cluster() must not be
// called for it then: CheckConfig() refuses it.
ClusterFunction& PclClustering();

}  // namespace unlidar
