// Clustering engines behind Cluster(), and their neighbour tests.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "paper/clustering.hpp"

namespace unlidar::internal {

// A ClusterFunction.
Clustering ClusterByGrid(const std::vector<Eigen::Vector3f>& points_m,
                         const ClusteringConfig& config);

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

}  // namespace unlidar::internal
