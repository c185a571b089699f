// What the program does: from the frames that the command line names to the files.
#pragma once

#include "app/arguments.hpp"

namespace unlidar {

// Tracks the drones of a recording, or while frames come. Throws Error.
void TrackDrones(const Arguments& arguments);

}  // namespace unlidar
