// Returns that hang together: single linkage with a radius that grows with range.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "robust/scene/range_grid.hpp"

namespace unlidar {

// Groups of `returns` (ascending indices of points), in the order of their first members, each
// ascending. Two returns are joined that are nearer to each other than the radius at the one with
// the lower x, or, where both have the same x, at the first of them. (Distances and radii are
// floats: which pairs lie on the boundary is part of the definition.)
//
// Takes time nearly in proportion to the number of returns, however dense they lie.
std::vector<std::vector<std::uint32_t>> Link(const std::vector<Eigen::Vector3f>& points_m,
                                             const std::vector<std::uint32_t>& returns,
                                             const RangeRadius& radius);

}  // namespace unlidar
