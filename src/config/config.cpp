#include "config/config.hpp"

#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <numeric>
#include <set>
#include <sstream>
#include <string_view>

#include "base/format.hpp"
#include "config/config_keys.hpp"
#include "config/config_values.hpp"
#include "io/input_file.hpp"
#include "io/pose_file.hpp"
#include "paper/clustering.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::size_t kMaxConfigBytes = 1 << 18;
constexpr std::string_view kSensorPrefix = "sensors.";

std::size_t EditDistance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({substituted, diagonal + 1, row[j] + 1});
    }
  }
  return row.back();
}

// `location`: prefix of the message that ends in ": ", or empty.
void CheckSensorName(const std::string& location, const std::string& name) {
  if (IsSensorName(name)) return;
  throw ConfigError(location + "sensors: " + Quoted(name) + ", " + kExpectedSensorName);
}

// Overlays values on a config and records the source location of each for messages.
class Overlay {
 public:
  explicit Overlay(Config& config) : config_(config) {}

  // Applies the map under the dotted prefix; where(node) returns a node's source location.
  template <class LocationOf>
  void ApplyMap(const std::string& prefix, const YAML::Node& map, const LocationOf& where) {
    std::set<std::string> seen;
    for (const auto& item : map) {
      // A dotted key would be a second notation for a nested one, and could override it unnoticed.
      if (!item.first.IsScalar() || item.first.Scalar().find('.') != std::string::npos) {
        throw ConfigError(where(item.first) + ": " + Quote(item.first) +
                          " is not a key, expected a plain name (sections are nested)");
      }
      const std::string key = (prefix.empty() ? "" : prefix + ".") + item.first.Scalar();
      if (!seen.insert(key).second) {
        throw ConfigError(where(item.first) + ": " + Shortened(key) + ": repeated, expected once");
      }
      if (IsSection(key)) {
        ApplySection(key, item.second, where(item.first), where);
      } else {
        ApplyValue(key, item.second, where(item.first));
      }
    }
  }

  void ApplyValue(const std::string& key, const YAML::Node& node, const std::string& location) {
    bool known = false;
    const auto assign = [&](const std::string& name, auto& field, const auto& constraint) {
      if (name != key) return;
      known = true;
      if (!Read(node, field, constraint)) {
        throw ConfigError(location + ": " + Shortened(key) + ": " + Quote(node) + ", expected " +
                          Expected(field, constraint) + FormerRuleHint(key, node));
      }
      locations_[key] = location;
    };
    VisitKeys(assign, config_);
    const std::size_t last_dot = key.rfind('.');
    if (IsBelowSensors(key) && last_dot >= kSensorPrefix.size()) {
      SensorConfig& sensor = SensorOf(key.substr(0, last_dot), location);
      VisitSensorKeys(assign, key.substr(0, last_dot + 1), sensor);
    }
    if (!known) {
      throw ConfigError(location + ": " + Shortened(key) + ": unknown key" + Suggestion(key));
    }
  }

  // Source location of each value, by key.
  const std::map<std::string, std::string>& locations() const { return locations_; }

 private:
  static bool IsBelowSensors(const std::string& key) {
    return key.compare(0, kSensorPrefix.size(), kSensorPrefix) == 0;
  }

  bool IsSection(const std::string& key) {
    bool is_section =
        key == "sensors" ||
        (IsBelowSensors(key) && key.find('.', kSensorPrefix.size()) == std::string::npos);
    VisitKeys(
        [&](const std::string& name, const auto&, const auto&) {
          is_section = is_section || name.compare(0, key.size() + 1, key + ".") == 0;
        },
        config_);
    return is_section;
  }

  template <class LocationOf>
  void ApplySection(const std::string& key, const YAML::Node& node, const std::string& location,
                    const LocationOf& where) {
    if (IsBelowSensors(key)) SensorOf(key, location);  // an empty entry is the identity pose
    if (node.IsNull()) return;                         // a section with all keys commented out
    if (!node.IsMap()) {
      throw ConfigError(location + ": " + Shortened(key) + ": " + Quote(node) +
                        ", expected a section of `key: value` lines");
    }
    ApplyMap(key, node, where);
  }

  // Returns a hint for the message about a list that names a rule of an earlier version.
  static std::string FormerRuleHint(const std::string& key, const YAML::Node& node) {
    if (key != "robust.disabled_rules" || !node.IsSequence()) return "";
    for (const std::string_view rule : kFormerRules) {
      for (const YAML::Node& name : node) {
        if (name.IsScalar() && name.Scalar() == rule)
          return "; the method has no rule " + std::string(rule) + " any more";
      }
    }
    return "";
  }

  SensorConfig& SensorOf(const std::string& key, const std::string& location) {
    const std::string name = key.substr(kSensorPrefix.size());
    CheckSensorName(location + ": ", name);
    return config_.sensors[name];
  }

  // Returns a hint for the message: what became of a former key, or the nearest key if one is
  // close.
  std::string Suggestion(const std::string& key) {
    if (const FormerKey* const former = FindFormerKey(key)) {
      return former->now.empty() ? "; the method has no such setting any more"
                                 : "; it is " + std::string(former->now) + " now";
    }
    std::string best;
    std::size_t best_distance = std::max<std::size_t>(3, key.size() / 3);
    const auto consider = [&](const std::string& name, const auto&, const auto&) {
      if (key.size() >= name.size() + best_distance) return;  // the key may be arbitrarily long
      std::size_t distance = EditDistance(key, name);
      // The right name in the wrong section also counts as close.
      if (name.substr(name.rfind('.') + 1) == key.substr(key.rfind('.') + 1)) distance = 1;
      if (distance >= best_distance) return;
      best_distance = distance;
      best = name;
    };
    VisitKeys(consider, config_);
    if (IsBelowSensors(key)) {
      const SensorConfig sensor;
      VisitSensorKeys(consider, key.substr(0, key.rfind('.') + 1), sensor);
    }
    return best.empty() ? "; configs/default.yaml lists all" : "; did you mean " + best + "?";
  }

  Config& config_;
  std::map<std::string, std::string> locations_;
};

std::string ReadText(const std::string& path) {
  try {
    return ReadWhole(path, {"a YAML file of config keys"}, kMaxConfigBytes);
  } catch (const InputError& error) {
    throw ConfigError(error.what());
  }
}

// Records where documents begin; ignores their values.
struct DocumentLines : YAML::EventHandler {
  int line = 0;  // of the last document start, from 1

  void OnDocumentStart(const YAML::Mark& mark) override { line = mark.line + 1; }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t,
                const std::string&) override {}
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                  YAML::EmitterStyle::value) override {}
  void OnMapEnd() override {}
};

// Returns the root of the only YAML document in the text; errors are prefixed with location(line).
//
// YAML::LoadAll never ends if the parser cannot pass a character (a comma outside of a list): it
// keeps returning an empty document before it. So only two documents are requested; the second
// begins with either another document or such a character.
template <class Place>
YAML::Node ParseYaml(const std::string& text, const Place& location) {
  try {
    std::istringstream stream(text);
    YAML::Parser parser(stream);
    DocumentLines documents;
    if (parser.HandleNextDocument(documents) && parser.HandleNextDocument(documents)) {
      throw ConfigError(location(documents.line) +
                        ": what stands here is no part of the YAML document before it, expected "
                        "one document");
    }
    return YAML::Load(text);
  } catch (const YAML::DeepRecursion& error) {
    throw ConfigError(location(error.mark.line + 1) + ": more than " +
                      std::to_string(error.depth()) + " levels, expected sections with keys");
  } catch (const YAML::Exception& error) {
    throw ConfigError(location(error.mark.line + 1) + ": " + Shortened(error.msg, 200) +
                      ", expected YAML");
  }
}

void ApplyFile(const std::string& path, Overlay& overlay) {
  const auto location = [&](int line) { return path + ":" + std::to_string(line); };
  const auto where = [&](const YAML::Node& node) { return location(node.Mark().line + 1); };
  const YAML::Node root = ParseYaml(ReadText(path), location);
  if (root.IsNull()) return;  // comments only
  if (!root.IsMap()) {
    throw ConfigError(where(root) + ": " + Quote(root) + ", expected `section: ...` lines");
  }
  overlay.ApplyMap("", root, where);
}

void ApplyAssignment(const std::string& assignment, Overlay& overlay) {
  const std::string location = "--set " + Shortened(assignment);
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw UsageError(location + ": expected section.key=value");
  }
  const YAML::Node value = ParseYaml(
      assignment.substr(equals + 1), [&](int) -> const auto& { return location; });
  overlay.ApplyValue(assignment.substr(0, equals), value, location);
}

// Empty without a problem.
std::string PosesProblem(const std::vector<Pose>& poses) {
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::string problem = PoseProblem(i == 0 ? nullptr : &poses[i - 1], poses[i]);
    if (!problem.empty()) return "pose " + std::to_string(i + 1) + ": " + problem;
  }
  return poses.size() < 2 ? Count(poses.size(), "pose") + ", expected at least two" : "";
}

// Checks the constraints between keys, and between keys and what is linked. `locations`: source
// locations of values by key for messages, as far as known. Throws ConfigError.
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

}  // namespace

Config LoadConfig(const std::string& path, const std::vector<std::string>& assignments) {
  Config config;
  Overlay overlay(config);
  if (!path.empty()) ApplyFile(path, overlay);
  for (const std::string& assignment : assignments) ApplyAssignment(assignment, overlay);
  CheckConsistent(config, overlay.locations());
  return config;
}

void CheckConfig(const Config& config) {
  const auto check = [](const std::string& key, const auto& field, const auto& constraint) {
    if (Holds(field, constraint)) return;
    throw ConfigError(key + ": " + TextOf(field) + ", expected " + Expected(field, constraint));
  };
  VisitKeys(check, config);
  for (const auto& [name, sensor] : config.sensors) {
    CheckSensorName("", name);
    VisitSensorKeys(check, std::string(kSensorPrefix) + name + ".", sensor);
  }
  CheckConsistent(config, {});
}

void CheckSensorNames(const Config& config, const std::vector<FrameSource>& sources) {
  const auto unused =
      std::find_if(config.sensors.begin(), config.sensors.end(), [&](const auto& sensor) {
        return std::none_of(sources.begin(), sources.end(),
                            [&](const FrameSource& s) { return s.name == sensor.first; });
      });
  if (unused == config.sensors.end()) return;
  for (const FrameSource& source : sources) {
    if (source.name.empty() || config.sensors.count(source.name) > 0) continue;
    const std::string name = Shortened(source.name);
    throw ConfigError("--frames " + name + "=" + source.directory + ": the config has no sensors." +
                      name + " but an unused sensors." + Shortened(unused->first) +
                      ", expected the same name (an empty sensors." + name +
                      " is the identity pose)");
  }
}

nlohmann::ordered_json ConfigJson(const Config& config) {
  auto root = nlohmann::ordered_json::object();
  const auto add = [&](const std::string& key, const auto& field, const auto& constraint) {
    nlohmann::ordered_json* node = &root;
    for (const std::string_view name : Split(key, '.')) {
      // A null that operator[] makes an object is no sound one where memory ends.
      node = &*node->emplace(std::string(name), nlohmann::ordered_json::object()).first;
    }
    *node = JsonOf(field, constraint);
  };
  VisitKeys(add, config);
  for (const auto& [name, sensor] : config.sensors) {
    VisitSensorKeys(add, std::string(kSensorPrefix) + name + ".", sensor);
  }
  return root;
}

}  // namespace unlidar
