// Everything a user can set: the stages' own config structs under one roof, and their key names.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "io/frames.hpp"
#include "live/live_config.hpp"
#include "paper/paper.hpp"
#include "robust/robust.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

enum class Method { kRobust, kPaper };

// Defaults stand in the structs of the stages and nowhere else; configs/default.yaml, which
// documents them, is held equal by a test.
struct Config {
  Method method = Method::kRobust;
  InputConfig input;
  std::map<std::string, SensorConfig> sensors;  // by the NAME of --frames NAME=DIR
  PaperConfig paper;
  RobustConfig robust;
  TrajectoryConfig trajectory;
  LiveConfig live;
};

// The defaults, overlaid by the YAML file (none for an empty path), overlaid by `section.key=value`
// assignments in their order.
// Throws ConfigError for an unreadable file, bad YAML, an unknown or repeated key, a value that
// breaks its constraint; UsageError for an assignment that is not `key=value`.
Config LoadConfig(const std::string& path, const std::vector<std::string>& assignments);

// Throws ConfigError if a named source has no entry in `sensors` while an entry there has no
// source: with one name misspelt, the other sensor's pose would silently not be applied.
void CheckSensorNames(const Config& config, const std::vector<FrameSource>& sources);

// A name that `sensors` can hold: letters, digits, '_' and '-'.
bool IsSensorName(const std::string& name);

using ConfigValue = std::variant<bool, std::int64_t, double, std::string, std::vector<double>>;

struct ConfigEntry {
  std::string key;  // dotted: "input.max_range_m"
  ConfigValue value;
};

// Every key with its value, in the order of configs/default.yaml.
std::vector<ConfigEntry> ListConfig(const Config& config);

}  // namespace unlidar
