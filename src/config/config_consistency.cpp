// Constraints between keys, and between keys and what is linked.
#include <cstddef>
#include <vector>

#include "base/format.hpp"
#include "config/config.hpp"
#include "config/config_values.hpp"
#include "io/pose_file.hpp"
#include "paper/clustering.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Empty without a problem.
std::string PosesProblem(const std::vector<Pose>& poses) {
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::string problem = PoseProblem(i == 0 ? nullptr : &poses[i - 1], poses[i]);
    if (!problem.empty()) return "pose " + std::to_string(i + 1) + ": " + problem;
  }
  return poses.size() < 2 ? Count(poses.size(), "pose") + ", expected at least two" : "";
}

}  // namespace

void CheckConsistent(const Config& config, const std::map<std::string, std::string>& locations) {
  const auto prefix_of = [&](const std::string& key) {
    const auto location = locations.find(key);
    return location == locations.end() ? std::string() : location->second + ": ";
  };
  const auto check_order = [&](const std::string& low_key, double low, const std::string& high_key,
                               double high) {
    if (low < high) return;
    const std::string prefix = prefix_of(locations.count(high_key) > 0 ? high_key : low_key);
    throw ConfigError(prefix + high_key + ": '" + NumberText(high) + "', expected more than " +
                      low_key + " (" + NumberText(low) + ")");
  };
  const InputConfig& input = config.input;
  check_order("input.min_range_m", input.min_range_m, "input.max_range_m", input.max_range_m);
  check_order("live.reorder_s", config.live.reorder_s, "live.delay_s", config.live.delay_s);
  const auto check_engine = [&](const std::string& key, const ClusteringConfig& clustering) {
    if (clustering.engine != ClusterEngine::kPcl || PclClustering() != nullptr) return;
    throw ConfigError(prefix_of(key) + key + ": 'pcl', expected grid: PCL is not linked");
  };
  check_engine("paper.global_clusters.engine", config.paper.global_clusters);
  check_engine("paper.local_clusters.engine", config.paper.local_clusters);
  for (const auto& [name, poses] : config.poses) {
    const std::string problem = poses == nullptr ? "none, expected some" : PosesProblem(*poses);
    if (!problem.empty()) throw ConfigError("poses of '" + name + "': " + problem);
  }
}

}  // namespace unlidar
