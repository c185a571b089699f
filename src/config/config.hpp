// Config functions for the command line, the summary and each other.
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/frames.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Throws ConfigError if a named source has no entry in `sensors` while an entry there has no
// source: with one name misspelt, the other sensor's pose would silently be ignored.
void CheckSensorNames(const Config& config, const std::vector<FrameSource>& sources);

// Checks the constraints between keys, and between keys and what is linked. `locations`: source
// locations of values by key for messages, as far as known. Throws ConfigError.
void CheckConsistent(const Config& config, const std::map<std::string, std::string>& locations);

// Returns every key with its value, nested and in order as in configs/default.yaml.
nlohmann::ordered_json ConfigJson(const Config& config);

}  // namespace unlidar
