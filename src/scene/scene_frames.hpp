// Selection of the frames from which the static scene is learned.
#pragma once

#include <cstdint>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Returns the frames to learn the static scene from; about a minute suffices. All frames if at most
// 90 of the recording's seconds contain any, else the frames of every 2nd, 3rd, ... of these
// seconds, so that a long recording takes no longer than its parts.
std::vector<FrameInfo> SceneFrames(const Recording& recording);

// Returns those of `returns` (ascending indices) that belong to `frames`.
std::vector<std::uint32_t> ReturnsOf(const std::vector<FrameInfo>& frames,
                                     const std::vector<std::uint32_t>& returns);

}  // namespace unlidar
