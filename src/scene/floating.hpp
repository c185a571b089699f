// Detects static plots without support.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/range_grid.hpp"
#include "scene/support.hpp"

namespace unlidar {

// Sets is_floating of the plots that are static and unsupported. Static: their place holds more
// plots than chance allows, which excludes rain. Plots with neighbours (other static plots beside
// them at the same time, more than the surroundings explain) are excluded, because objects hit too
// seldom to be structure can hold something up as well; static plots at other times do not count,
// as they may be the target itself. Replays of a frame are excluded, too. A transient place may
// float even if part of its surroundings is hidden: an object that is held up does not appear and
// vanish.
void MarkFloating(const Recording& recording, const Support& support, const RobustConfig& config,
                  std::vector<Plot>* plots);

}  // namespace unlidar
