// The targets of recordings that are too long to be looked at at once.
#pragma once

#include <functional>
#include <vector>

#include "base/recording.hpp"
#include "recording/robust.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Appends the next frames of a recording, those with a stamp before `until_ns`, which ascends from
// call to call, and tells the sensors. Gives the stamp of the frame that is next then; the largest
// TimeNs if there is none.
using FrameFeed = std::function<TimeNs(TimeNs until_ns, Recording* recording)>;

// Whether a recording is searched window by window: if it is longer than one.
bool NeedsWindows(TimeNs first_stamp_ns, TimeNs last_stamp_ns, const RobustConfig& config);

// FindTargetsRobust for a recording of any length, in the memory that a window takes. Windows are
// of one length, at most robust.window_s; each is searched with robust.window_margin_s before and
// behind it; two targets of neighbouring windows are one if they share most of their returns about
// the border between them, where the one hands over to the other. `recording`, empty before, gets
// the sensors, all frames, and of the returns those of the targets, which have their indices there.
// `trace`, if there is one, is told of each window in turn, with its margins: frames about a border
// are in two.
//
// The counts are sums over the windows, margins included, and the largest threshold.
RobustResult FindTargetsInWindows(const FrameFeed& feed, TimeNs first_stamp_ns,
                                  TimeNs last_stamp_ns, const RobustConfig& config,
                                  const TrajectoryConfig& trajectory_config, const TraceSink& trace,
                                  Recording* recording);

}  // namespace unlidar
