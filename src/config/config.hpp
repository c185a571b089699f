// Config functions for the command line and the summary.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "io/frames.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Throws ConfigError if a named source has no entry in `sensors` while an entry there has no
// source: with one name misspelt, the other sensor's pose would silently be ignored.
void CheckSensorNames(const Config& config, const std::vector<FrameSource>& sources);

// Returns every key with its value, nested and in order as in configs/default.yaml.
nlohmann::ordered_json ConfigJson(const Config& config);

}  // namespace unlidar
