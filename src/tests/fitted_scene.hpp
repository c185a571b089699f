// Ground and support of given points in one call, for tests.
#pragma once

#include "base/recording.hpp"
#include "scene/field_of_view.hpp"
#include "scene/ground.hpp"
#include "scene/support.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

inline Ground GroundOf(const PointsView& points_m) {
  Ground ground;
  ground.Fit(points_m);
  return ground;
}

inline Support SupportBy(const PointsView& structure_m, const Ground& ground,
                         const SupportConfig& config, const ElevationRange& view = {}) {
  Support support(ground, config);
  support.Fill(structure_m, std::vector<char>(structure_m.size(), 1), view);
  return support;
}

}  // namespace unlidar
