// Targets of recordings of any length, in bounded memory.
#pragma once

#include <functional>

#include "base/recording.hpp"
#include "recording/robust.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Appends the next frames of a recording, those stamped before `until_ns`, which ascends from call
// to call, and sets the sensors. Returns the stamp of the following frame; the largest TimeNs if
// there is none.
using FrameFeed = std::function<TimeNs(TimeNs until_ns, Recording* recording)>;

// FindTargetsRobust() for a recording of any length, in the memory of one window: association with
// hindsight needs the whole of what it looks at. Windows have equal lengths, at most
// robust.window_s; a longer recording has several, each of them searched with
// robust.window_margin_s on both sides. Two targets of neighbouring windows are merged if they
// share most of their returns near the border, where the one hands over to the other. `recording`,
// initially empty, receives the sensors, all frames, and the returns of the targets, whose indices
// refer to it. `trace`, if set, receives each window with its margins: frames near a border are in
// two.
//
// The counts are sums over the windows, margins included, and the largest threshold.
RobustResult FindTargetsInWindows(const FrameFeed& feed, TimeNs first_stamp_ns,
                                  TimeNs last_stamp_ns, const RobustConfig& config,
                                  const TrajectoryConfig& trajectory_config, const TraceSink& trace,
                                  Recording* recording);

}  // namespace unlidar
