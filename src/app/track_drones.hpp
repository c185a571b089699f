// Top level of the program: from the frames named on the command line to the output files.
#pragma once

#include "app/arguments.hpp"

namespace unlidar {

// Tracks the drones of a recording, or while frames come. Throws Error.
void TrackDrones(const Arguments& arguments);

}  // namespace unlidar
