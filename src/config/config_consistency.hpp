// Constraints between keys, and between keys and what is linked.
#pragma once

#include <map>
#include <string>

#include "unlidar/config.hpp"

namespace unlidar {

// `locations`: source locations of values by key for messages, as far as known. Throws ConfigError.
void CheckConsistent(const Config& config, const std::map<std::string, std::string>& locations);

}  // namespace unlidar
