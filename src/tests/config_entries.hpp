// The keys of a config one by one.
#pragma once

#include <string>
#include <vector>

#include "config/config.hpp"

namespace unlidar::testing {

struct ConfigEntry {
  std::string key;  // dotted: "input.max_range_m"
  nlohmann::ordered_json value;
};

inline void AppendEntries(const nlohmann::ordered_json& section, const std::string& prefix,
                          std::vector<ConfigEntry>& entries) {
  for (const auto& [name, value] : section.items()) {
    if (value.is_object()) {
      AppendEntries(value, prefix + name + ".", entries);
    } else {
      entries.push_back({prefix + name, value});
    }
  }
}

// Returns every key with its value, in the order of configs/default.yaml.
inline std::vector<ConfigEntry> ListConfig(const Config& config) {
  std::vector<ConfigEntry> entries;
  AppendEntries(ConfigJson(config), "", entries);
  return entries;
}

}  // namespace unlidar::testing
