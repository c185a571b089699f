// Engine `pcl`: PCL's own cluster extraction, instantiated here so that the program does not link
// pcl_segmentation, pcl_search and pcl_kdtree, whose libraries add 69 ms to start-up.
#define PCL_NO_PRECOMPILE
#include "pcl/pcl_clustering.hpp"

#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

#include <memory>
#include <pcl/kdtree/impl/kdtree_flann.hpp>
#include <pcl/search/impl/kdtree.hpp>
#include <pcl/search/impl/search.hpp>
#include <pcl/segmentation/impl/extract_clusters.hpp>

#include "base/algorithms.hpp"
#include "paper/clustering.hpp"

namespace unlidar {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

Clustering ClusterEuclidean(const Cloud::Ptr& cloud, double tolerance_m) {
  auto tree = std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>(false);
  tree->setInputCloud(cloud);
  std::vector<pcl::PointIndices> clusters;  // in order of their lowest index
  pcl::extractEuclideanClusters<pcl::PointXYZ>(*cloud, tree, static_cast<float>(tolerance_m),
                                               clusters);
  Clustering result;
  result.labels.assign(cloud->size(), kNoise);
  for (const pcl::PointIndices& cluster : clusters) {
    for (const pcl::index_t i : cluster.indices) {
      result.labels[static_cast<std::size_t>(i)] = result.num_clusters;
    }
    ++result.num_clusters;
  }
  return result;
}

// PCL has no DBSCAN: its tree finds candidates, DbscanRule decides, and clusters are grown from
// each unlabelled core point in turn (Ester et al.).
Clustering ClusterDbscan(const std::vector<Eigen::Vector3f>& points_m, const Cloud::Ptr& cloud,
                         const ClusteringConfig& config) {
  const DbscanRule rule(config.tolerance_m);
  pcl::KdTreeFLANN<pcl::PointXYZ> tree(false);
  tree.setInputCloud(cloud);
  pcl::Indices found;
  std::vector<float> squared_distances;
  const auto find_neighbours = [&](std::size_t i) {
    // Exceeds the radius by more than the tree's rounding errors.
    tree.radiusSearch((*cloud)[i], config.tolerance_m * (1.0 + 1e-5), found, squared_distances);
    EraseIf(&found, [&](pcl::index_t j) {
      return !rule.Near(points_m[i], points_m[static_cast<std::size_t>(j)]);
    });
  };

  const auto min_neighbours = static_cast<std::size_t>(config.min_neighbours);
  std::vector<bool> is_core(points_m.size());
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    find_neighbours(i);
    is_core[i] = found.size() >= min_neighbours;
  }
  Clustering result;
  result.labels.assign(points_m.size(), kNoise);
  for (std::size_t seed = 0; seed < points_m.size(); ++seed) {
    if (!is_core[seed] || result.labels[seed] != kNoise) continue;
    std::vector<std::size_t> stack = {seed};
    result.labels[seed] = result.num_clusters;
    while (!stack.empty()) {
      find_neighbours(stack.back());
      stack.pop_back();
      for (const pcl::index_t found_index : found) {
        const auto j = static_cast<std::size_t>(found_index);
        if (result.labels[j] != kNoise) continue;
        result.labels[j] = result.num_clusters;
        if (is_core[j]) stack.push_back(j);
      }
    }
    ++result.num_clusters;
  }
  return result;
}

Clustering ClusterByPcl(const std::vector<Eigen::Vector3f>& points_m,
                        const ClusteringConfig& config) {
  const auto cloud = std::make_shared<Cloud>();
  for (const Eigen::Vector3f& p : points_m) cloud->emplace_back(p.x(), p.y(), p.z());
  return config.method == ClusterMethod::kEuclidean ? ClusterEuclidean(cloud, config.tolerance_m)
                                                    : ClusterDbscan(points_m, cloud, config);
}

}  // namespace

void UsePclClustering() { PclClustering() = ClusterByPcl; }

}  // namespace unlidar
