// Tracks of the drones in an in-memory recording. docs/cpp_api.md has an example.
#pragma once

#include <string>
#include <vector>

#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// The trajectory of one drone. Ids count from 0 in order of first evidence.
struct Track {
  int id = 0;
  TimeNs begin_ns = 0;  // first and last evidence
  TimeNs end_ns = 0;
  Kind kind;
  MinimumReport minimum;            // of the fit behind the rows
  std::vector<TrajectoryRow> rows;  // one per output time of its existence, ascending
};

// Returns the tracks that the program writes for the same frames, row by row; none if nothing
// flies. `sensors`: names of the LiDARs by Frame::sensor, the keys to `sensors` of the config.
// Frames may be in any order. Throws the same as Engine.
std::vector<Track> TrackRecording(const Config& config, const std::vector<std::string>& sensors,
                                  std::vector<Frame> frames,
                                  const OutputTimes& output_times = FirstSensorStamps{});

}  // namespace unlidar
