#pragma once

namespace unlidar {

inline double Square(double x) { return x * x; }

}  // namespace unlidar
