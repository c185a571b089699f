// JSON parts shared by the summaries of recordings and of live runs.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "config/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Returns the effective configuration, nested as in its YAML file.
nlohmann::ordered_json ConfigJson(const Config& config);

nlohmann::ordered_json KindJson(const Kind& kind);

nlohmann::ordered_json SplineJson(const MinimumReport& minimum);
nlohmann::ordered_json WarningsJson(const std::vector<Warning>& warnings);

}  // namespace unlidar
