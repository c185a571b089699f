// Tracks of the drones in a recording that is in memory.
//
//   std::vector<unlidar::Frame> frames = ...;  // {sensor, stamp_ns, points_m, offsets_ns}
//   for (const unlidar::Track& track : unlidar::TrackRecording({}, {"roof"}, frames)) {
//     for (const unlidar::TrajectoryRow& row : track.rows) Print(row.time_ns, row.position_m);
//   }
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
  MinimumReport minimum;            // of the fit that gave the rows
  std::vector<TrajectoryRow> rows;  // one per output time while it was there, in order of time
};

// `sensors`: the names of the LiDARs by the index in their frames, which tie them to `sensors` of
// the config. Frames in any order. What the program writes of the same frames, row by row; no track
// where nothing flies. Throws what Engine throws.
std::vector<Track> TrackRecording(const Config& config, const std::vector<std::string>& sensors,
                                  std::vector<Frame> frames,
                                  const OutputTimes& output_times = FirstSensorStamps{});

}  // namespace unlidar
