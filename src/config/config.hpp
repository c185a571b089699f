// Config functions for the command line and the summary.
#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "io/frames.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Throws ConfigError if a named source has no entry in `sensors` while an entry there has no
// source: with one name misspelt, the other sensor's pose would silently be ignored.
void CheckSensorNames(const Config& config, const std::vector<FrameSource>& sources);

using ConfigValue = std::variant<bool, std::int64_t, double, std::string, std::vector<double>,
                                 std::vector<std::string>>;

struct ConfigEntry {
  std::string key;  // dotted: "input.max_range_m"
  ConfigValue value;
};

// Returns every key with its value, in the order of configs/default.yaml.
std::vector<ConfigEntry> ListConfig(const Config& config);

}  // namespace unlidar
