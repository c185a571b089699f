// Whether what seems to float does.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/range_grid.hpp"
#include "scene/support.hpp"

namespace unlidar {

// Sets is_floating of the plots (as MakePlots gives them) that stand still where nothing holds them
// up: seen at one place more often than chance has it, and without anything else that stands
// still beside them at the same time, beyond what the surroundings explain. What is seen too seldom
// to be structure may hold things up as well. (At other times it may be the target itself.) Rain
// does not stand still. A repetition of a frame floats no more than what it repeats. What is seen
// at its place for a while only has come there, as nothing that stands does.
void MarkFloating(const Recording& recording, const Support& support, const RobustConfig& config,
                  std::vector<Plot>* plots);

}  // namespace unlidar
