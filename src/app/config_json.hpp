// The effective configuration in summaries.
#pragma once

#include <nlohmann/json.hpp>

#include "app/config.hpp"

namespace unlidar {

// Nested as in its YAML file.
nlohmann::ordered_json ConfigJson(const Config& config);

}  // namespace unlidar
