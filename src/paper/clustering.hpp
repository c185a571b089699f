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

// The engine `grid`, a ClusterFunction.
Clustering ClusterByGrid(const std::vector<Eigen::Vector3f>& points_m,
                         const ClusteringConfig& config);

// Labels finite points; clusters of any size are numbered by lowest core index.
using ClusterFunction = Clustering (*)(const std::vector<Eigen::Vector3f>& points_m,
                                       const ClusteringConfig& config);

// The engine `pcl`; null where it is not linked, see pcl/pcl_clustering.hpp. Cluster() must not be
// called for it then: CheckConfig() refuses it.
ClusterFunction& PclClustering();

// Neighbour test of Euclidean clustering. PCL rounds the tolerance to float, squares it in double
// and rounds again; FLANN's L2_Simple sums squared float differences in the order x, y, z and keeps
// sums below the squared radius. Every step is repeated here, since a single different rounding
// changes points that lie exactly on the boundary. Requires a compiler that neither contracts nor
// reorders floating point, see cmake/CompilerOptions.cmake.
//
// FLANN also prunes branches of its tree by a distance with accumulated rounding errors, so in
// principle it may lose a pair within a few units in the last place of the boundary.
struct EuclideanRule {
  explicit EuclideanRule(double tolerance_m) {
    const double radius_m = static_cast<float>(tolerance_m);
    squared_radius_m2 = static_cast<float>(radius_m * radius_m);
  }
  bool Near(const Eigen::Vector3f& a, const Eigen::Vector3f& b) const {
    const float dx = a.x() - b.x();
    const float dy = a.y() - b.y();
    const float dz = a.z() - b.z();
    return dx * dx + dy * dy + dz * dz < squared_radius_m2;
  }
  float squared_radius_m2;
};

// Neighbour test of DBSCAN: scikit-learn's KD tree sums in double and keeps sums up to the squared
// radius.
struct DbscanRule {
  explicit DbscanRule(double tolerance_m) : squared_radius_m2(tolerance_m * tolerance_m) {}
  bool Near(const Eigen::Vector3f& a, const Eigen::Vector3f& b) const {
    const double dx = static_cast<double>(a.x()) - static_cast<double>(b.x());
    const double dy = static_cast<double>(a.y()) - static_cast<double>(b.y());
    const double dz = static_cast<double>(a.z()) - static_cast<double>(b.z());
    return dx * dx + dy * dy + dz * dz <= squared_radius_m2;
  }
  double squared_radius_m2;
};

}  // namespace unlidar
