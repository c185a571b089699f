// The frames that tell what stands still.
#pragma once

#include <cstdint>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// What stands still is known from a minute or so: up to 90 seconds that hold frames, all frames; of
// a longer recording those of every second one of its seconds, or every third, and so on, so that a
// long one takes no longer than its parts.
std::vector<FrameInfo> SceneFrames(const Recording& recording);

// Those of ascending returns that are of these frames.
std::vector<std::uint32_t> ReturnsOf(const std::vector<FrameInfo>& frames,
                                     const std::vector<std::uint32_t>& returns);

}  // namespace unlidar
