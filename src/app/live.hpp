// Tracking while frames come: --follow, --stdin and --livox.
#pragma once

#include <string>

#include "app/arguments.hpp"
#include "app/output_files.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Runs until stdin ends or SIGTERM or SIGINT comes, then writes what is pending, also where it ends
// with an InputError. `note` gets lines for the user. Returns what was done, in a line.
// Throws UsageError, InputError, ConfigError, OutputError.
std::string TrackLive(const Arguments& arguments, const OutputTimes& output_times,
                      const Config& config, const NoteCallback& note);

}  // namespace unlidar
