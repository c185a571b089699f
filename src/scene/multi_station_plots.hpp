// Scene of each station of a recording, and the plots of all stations together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/background.hpp"
#include "scene/plots.hpp"
#include "scene/station_model.hpp"
#include "scene/stations.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Every station is processed with a scene and plots of its own, because ranges, directions and
// occlusion are relative to its viewpoint, and a place that one station sees well may be too seldom
// exposed for another to classify it.
class MultiStationPlots {
 public:
  MultiStationPlots(const Recording& recording, const Stations& stations,
                    const RobustConfig& config);

  // Plots of all stations, in the common coordinate frame, frame by frame in order of time.
  const std::vector<Plot>& plots() const { return plots_; }

  // (plots) Floating plots with returns that looked like structure: hovering throughout.
  const std::vector<char>& are_static_floating() const { return are_static_floating_; }

  // (returns) 1 for returns of bodies.
  const std::vector<char>& are_bodies() const { return are_bodies_; }

  std::size_t num_unexplained() const { return num_unexplained_; }

  // Sets log_clutter of all plots. `assigned` (plots): see unlidar::EstimateClutter.
  void EstimateClutter(const std::vector<char>& assigned);

  // Returns one model per sensor; they point into this object.
  std::vector<StationModel> StationModels() const;

 private:
  void AddStation(const Recording& whole, const Recording& own,
                  const std::vector<std::uint32_t>& frames, const RobustConfig& config);
  void SortByTime();

  Stations stations_;
  const RobustConfig& config_;
  std::size_t num_sensors_;
  std::vector<Background> backgrounds_;  // (stations)
  std::vector<Plot> plots_;
  std::vector<char> are_static_floating_;
  std::vector<char> are_bodies_;
  std::size_t num_unexplained_ = 0;
};

}  // namespace unlidar
