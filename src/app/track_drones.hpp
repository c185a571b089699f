// Top level of the program: from the frames named on the command line to the output files.
#pragma once

#include <string>

#include "app/arguments.hpp"
#include "app/output_files.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Tracks the drones of a recording, or while frames come. Throws Error.
void TrackDrones(const Arguments& arguments);

// The latter (--follow, --stdin, --livox): runs until stdin ends or SIGTERM or SIGINT comes, then
// writes what is pending, also where it ends with an InputError. `note` gets lines for the user.
// Returns what was done, in a line. Throws UsageError, InputError, ConfigError, OutputError.
std::string TrackLive(const Arguments& arguments, const OutputTimes& output_times,
                      const Config& config, const NoteCallback& note);

}  // namespace unlidar
