// Test-only program: prints the label of each point read from standard input ("x y z" a line).
//   cluster_labels euclidean|dbscan grid|pcl TOLERANCE_M MIN_NEIGHBOURS MIN_CLUSTER_SIZE
// It lets Python tests compare the clustering with scikit-learn.
#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include "paper/clustering.hpp"
#include "pcl/pcl_clustering.hpp"

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (arguments.size() != 5) {
    std::cerr << "usage: cluster_labels METHOD ENGINE TOLERANCE_M MIN_NEIGHBOURS MIN_SIZE\n";
    return 2;
  }
  try {
    unlidar::UsePclClustering();
    unlidar::ClusteringConfig config;
    config.method = arguments[0] == "dbscan" ? unlidar::ClusterMethod::kDbscan
                                             : unlidar::ClusterMethod::kEuclidean;
    config.engine =
        arguments[1] == "pcl" ? unlidar::ClusterEngine::kPcl : unlidar::ClusterEngine::kGrid;
    config.tolerance_m = std::stod(arguments[2]);
    config.min_neighbours = std::stoi(arguments[3]);
    config.min_cluster_size = std::stoi(arguments[4]);
    std::vector<Eigen::Vector3f> points_m;
    for (Eigen::Vector3f p; std::cin >> p.x() >> p.y() >> p.z();) points_m.push_back(p);
    for (const auto label : unlidar::Cluster(points_m, config).labels) std::cout << label << '\n';
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
  return 0;
}
