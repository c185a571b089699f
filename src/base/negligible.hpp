#pragma once

namespace unlidar {

// What is less likely by a larger log ratio is ignored: it changes no probability by 1e-5.
constexpr double kNegligibleLog = 12.0;

}  // namespace unlidar
