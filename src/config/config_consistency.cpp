#include "config/config_consistency.hpp"

#include "config/config_values.hpp"
#include "paper/clustering.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

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
}

}  // namespace unlidar
