// A recording in memory, tracked at once, as the events of a stream.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Emits the tracks of a recording: all confirmations, the rows in order of time, all ends. Returns
// the warnings about the recording. The RecordingTracker of LiveEngine.
std::vector<Warning> EmitTracksOf(const Recording& recording, const OutputTimes& output_times,
                                  const Config& config, const EngineCallback& on_event);

}  // namespace unlidar
