// Clusters of points by distance, exactly as PCL and scikit-learn define them.
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
// that joins two points when their squared distance, accumulated in float as FLANN does, is *below*
// float(tolerance)^2.
//
// kDbscan is sklearn.cluster.DBSCAN (Ester et al., KDD 1996) on the same coordinates as doubles:
// neighbours are at most `tolerance_m` apart, a point counts among its own, and a border point goes
// to the cluster, of those whose core points reach it, that holds the lowest core index.
//
// Clusters are numbered by their lowest core index (each point of a Euclidean cluster is core), as
// scikit-learn does, after those below `min_cluster_size` were dropped. Both engines give the same
// labels. Points that are not finite, or have a coordinate beyond 1e37 m, are noise.
//
Clustering Cluster(const std::vector<Eigen::Vector3f>& points_m, const ClusteringConfig& config);

}  // namespace unlidar
