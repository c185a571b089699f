// What Cluster() asks of an engine.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "paper/clustering.hpp"

namespace unlidar::internal {

// Each engine labels finite points, clusters of every size numbered by their lowest core index.
Clustering ClusterByGrid(const std::vector<Eigen::Vector3f>& points_m,
                         const ClusteringConfig& config);
Clustering ClusterByPcl(const std::vector<Eigen::Vector3f>& points_m,
                        const ClusteringConfig& config);

// Two points of a Euclidean cluster are neighbours. PCL rounds the tolerance to float, squares it
// in double and rounds it again; FLANN's L2_Simple sums the squares of float differences in the
// order x, y, z and keeps what is below the squared radius. Every step is repeated here, as one
// rounding more or less decides points that lie exactly on the boundary. It takes a compiler that
// neither contracts nor reorders floating point, see cmake/CompilerOptions.cmake.
//
// FLANN also skips branches of its tree whose distance it accumulates with rounding errors, so it
// may, in principle, lose a pair within a few units in the last place of the boundary.
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

// Two points are neighbours for DBSCAN: scikit-learn's KD tree sums in double and keeps what is at
// most the squared radius.
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

}  // namespace unlidar::internal
