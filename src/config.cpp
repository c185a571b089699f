#include "unlidar/config.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <numeric>
#include <set>
#include <string_view>
#include <utility>

#include "config_keys.hpp"
#include "config_values.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::size_t kMaxConfigBytes = 1 << 20;
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

std::string Join(const std::string& section, const std::string& key) {
  return section.empty() ? key : section + "." + key;
}

// Overlays values on a config and remembers where each came from, for messages.
class Overlay {
 public:
  explicit Overlay(Config& config) : config_(config) {}

  // Applies the map below the dotted prefix; where(node) names a node's place in the source.
  template <class Where>
  void ApplyMap(const std::string& prefix, const YAML::Node& map, const Where& where) {
    std::set<std::string> seen;
    for (const auto& item : map) {
      // A dotted key would be a second way to write, and hide, a nested one.
      if (!item.first.IsScalar() || item.first.Scalar().find('.') != std::string::npos) {
        throw ConfigError(where(item.first) + ": " + Quote(item.first) +
                          " is not a key, expected a plain name (sections are nested)");
      }
      const std::string key = Join(prefix, item.first.Scalar());
      if (!seen.insert(key).second) {
        throw ConfigError(where(item.first) + ": " + key + ": repeated, expected once");
      }
      if (IsSection(key)) {
        ApplySection(key, item.second, where(item.first), where);
      } else {
        ApplyValue(key, item.second, where(item.first));
      }
    }
  }

  void ApplyValue(const std::string& key, const YAML::Node& node, const std::string& place) {
    bool known = false;
    const auto assign = [&](const std::string& name, auto& field, const auto& constraint) {
      if (name != key) return;
      known = true;
      if (!Read(node, field, constraint)) {
        throw ConfigError(place + ": " + key + ": " + Quote(node) + ", expected " +
                          Expected(field, constraint));
      }
      places_[key] = place;
    };
    VisitKeys(assign, config_);
    const std::size_t last_dot = key.rfind('.');
    if (IsBelowSensors(key) && last_dot >= kSensorPrefix.size()) {
      SensorConfig& sensor = SensorOf(key.substr(0, last_dot), place);
      VisitSensorKeys(assign, key.substr(0, last_dot + 1), sensor);
    }
    if (!known) throw ConfigError(place + ": " + key + ": unknown key" + Suggestion(key));
  }

  // Constraints between keys.
  void CheckConsistent() const {
    const InputConfig& input = config_.input;
    CheckOrder("input.min_range_m", input.min_range_m, "input.max_range_m", input.max_range_m);
    const TrajectoryConfig& trajectory = config_.trajectory;
    CheckOrder("trajectory.min_acceleration_mps2", trajectory.min_acceleration_mps2,
               "trajectory.max_acceleration_mps2", trajectory.max_acceleration_mps2);
    CheckOrder("trajectory.min_noise_scale", trajectory.min_noise_scale,
               "trajectory.max_noise_scale", trajectory.max_noise_scale);
    CheckOrder("trajectory.min_knot_spacing_s", trajectory.min_knot_spacing_s,
               "trajectory.max_knot_spacing_s", trajectory.max_knot_spacing_s);
    CheckOrder("live.reorder_s", config_.live.reorder_s, "live.delay_s", config_.live.delay_s);
  }

 private:
  static bool IsBelowSensors(const std::string& key) {
    return key.compare(0, kSensorPrefix.size(), kSensorPrefix) == 0;
  }

  bool IsSection(const std::string& key) {
    if (key == "sensors" ||
        (IsBelowSensors(key) && key.find('.', kSensorPrefix.size()) == std::string::npos)) {
      return true;
    }
    bool is_section = false;
    VisitKeys(
        [&](const std::string& name, const auto&, const auto&) {
          is_section = is_section || name.compare(0, key.size() + 1, key + ".") == 0;
        },
        config_);
    return is_section;
  }

  template <class Where>
  void ApplySection(const std::string& key, const YAML::Node& node, const std::string& place,
                    const Where& where) {
    if (IsBelowSensors(key)) SensorOf(key, place);  // an empty entry is the identity pose
    if (node.IsNull()) return;                      // a section with all keys commented out
    if (!node.IsMap()) {
      throw ConfigError(place + ": " + key + ": " + Quote(node) +
                        ", expected a section of `key: value` lines");
    }
    ApplyMap(key, node, where);
  }

  SensorConfig& SensorOf(const std::string& key, const std::string& place) {
    const std::string name = key.substr(kSensorPrefix.size());
    if (!IsSensorName(name)) {
      throw ConfigError(place + ": sensors: '" + name +
                        "', expected a name of letters, digits, '_' and '-'");
    }
    return config_.sensors[name];
  }

  // "" or the nearest known key, if it is near.
  std::string Suggestion(const std::string& key) {
    std::string best;
    std::size_t best_distance = std::max<std::size_t>(3, key.size() / 3);
    const auto consider = [&](const std::string& name, const auto&, const auto&) {
      std::size_t distance = EditDistance(key, name);
      // The right name in the wrong section is near, too.
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

  void CheckOrder(const std::string& low_key, double low, const std::string& high_key,
                  double high) const {
    if (low < high) return;
    const auto high_place = places_.find(high_key);
    const auto place = high_place != places_.end() ? high_place : places_.find(low_key);
    throw ConfigError((place != places_.end() ? place->second + ": " : "") + high_key + ": '" +
                      NumberText(high) + "', expected more than " + low_key + " (" +
                      NumberText(low) + ")");
  }

  Config& config_;
  std::map<std::string, std::string> places_;
};

std::string ReadText(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text(kMaxConfigBytes + 1, '\0');
  // A directory opens, but cannot be read.
  if (!file || (!file.read(text.data(), static_cast<std::streamsize>(text.size())) && file.bad())) {
    throw ConfigError(path + ": cannot be read, expected a YAML file");
  }
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > kMaxConfigBytes) {
    throw ConfigError(path + ": more than " + std::to_string(kMaxConfigBytes) +
                      " bytes, expected a YAML file of config keys");
  }
  return text;
}

// The root of the one YAML document in the text; errors are prefixed by name and line.
YAML::Node ParseYaml(const std::string& text, const std::string& name) {
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(text);
    if (documents.size() > 1) {
      throw ConfigError(name + ": " + std::to_string(documents.size()) +
                        " YAML documents, expected one");
    }
    return documents.empty() ? YAML::Node() : documents.front();
  } catch (const YAML::Exception& error) {
    throw ConfigError(name + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg +
                      ", expected YAML");
  }
}

void ApplyFile(const std::string& path, Overlay& overlay) {
  const YAML::Node root = ParseYaml(ReadText(path), path);
  if (root.IsNull()) return;  // nothing but comments
  const auto where = [&](const YAML::Node& node) {
    return path + ":" + std::to_string(node.Mark().line + 1);
  };
  if (!root.IsMap()) {
    throw ConfigError(where(root) + ": " + Quote(root) + ", expected `section: ...` lines");
  }
  overlay.ApplyMap("", root, where);
}

void ApplyAssignment(const std::string& assignment, Overlay& overlay) {
  const std::string place = "--set " + assignment;
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw UsageError(place + ": expected section.key=value");
  }
  YAML::Node value;
  try {
    value = YAML::Load(assignment.substr(equals + 1));
  } catch (const YAML::Exception& error) {
    throw ConfigError(place + ": " + error.msg + ", expected a YAML value");
  }
  overlay.ApplyValue(assignment.substr(0, equals), value, place);
}

}  // namespace

bool IsSensorName(const std::string& name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  });
}

Config LoadConfig(const std::string& path, const std::vector<std::string>& assignments) {
  Config config;
  Overlay overlay(config);
  if (!path.empty()) ApplyFile(path, overlay);
  for (const std::string& assignment : assignments) ApplyAssignment(assignment, overlay);
  overlay.CheckConsistent();
  return config;
}

void CheckSensorNames(const Config& config, const std::vector<FrameSource>& sources) {
  std::string unused = "";
  for (const auto& [name, sensor] : config.sensors) {
    const bool used = std::any_of(sources.begin(), sources.end(),
                                  [&name = name](const auto& s) { return s.name == name; });
    if (!used && unused.empty()) unused = name;
  }
  if (unused.empty()) return;
  for (const FrameSource& source : sources) {
    if (source.name.empty() || config.sensors.count(source.name) > 0) continue;
    throw ConfigError("--frames " + source.name + "=" + source.directory +
                      ": the config has no sensors." + source.name + " but an unused sensors." +
                      unused + ", expected the same name (an empty sensors." + source.name +
                      " is the identity pose)");
  }
}

std::vector<ConfigEntry> ListConfig(const Config& config) {
  std::vector<ConfigEntry> entries;
  const auto list = [&](const std::string& key, const auto& field, const auto& constraint) {
    entries.push_back({key, ValueOf(field, constraint)});
  };
  VisitKeys(list, config);
  for (const auto& [name, sensor] : config.sensors) {
    VisitSensorKeys(list, std::string(kSensorPrefix) + name + ".", sensor);
  }
  return entries;
}

}  // namespace unlidar
