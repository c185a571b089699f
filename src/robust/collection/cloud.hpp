// What drifts, but is no body: steam, smoke, dust.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "robust/plots/plots.hpp"
#include "robust/scene/sensor_view.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Leaves out the targets that are clouds: what is about them at the same time, beyond what strays
// farther about them explain, lies wider than any drone. A cloud comes in many pieces, one after
// another on nearly the same way, and while they are small they look like drones: so what stays
// where a cloud is at some time is a piece of it. `plots` in order of time; `views`: (sensors).
std::vector<Target> WithoutClouds(const Recording& recording, const std::vector<SensorView>& views,
                                  const std::vector<Plot>& plots, std::vector<Target> targets,
                                  const TrajectoryConfig& config);

}  // namespace unlidar
