// Whether what seems to float does.
#pragma once

#include <vector>

#include "unlidar/robust/plots.hpp"

namespace unlidar {

// Takes back that a plot floats where something else was seen beside it at the same time: what is
// seen too seldom to be structure may hold things up as well. (At other times that may be the
// target itself.) In rain, where the surroundings are as full, that says nothing.
// A repetition of a frame floats no more than what it repeats. `plots` in order of time.
void ConfirmFloating(const Recording& recording, const SupportConfig& config,
                     std::vector<Plot>* plots);

}  // namespace unlidar
