// What the stations of a recording see: each by itself, and their plots together.
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

// Every station has a scene and plots of its own, as if it were alone: ranges, directions and what
// hides what begin at its viewpoint, and what one sees well another may see too seldom to judge it.
class MultiStationPlots {
 public:
  MultiStationPlots(const Recording& recording, const Stations& stations,
                    const RobustConfig& config);

  // Of all stations, in the common frame, frame by frame in order of time.
  const std::vector<Plot>& plots() const { return plots_; }

  // (plots) Those that float in one place.
  const std::vector<char>& are_static_floating() const { return are_static_floating_; }

  // (returns) Those of bodies.
  const std::vector<char>& are_bodies() const { return are_bodies_; }

  std::size_t num_unexplained() const { return num_unexplained_; }

  // Sets log_clutter of all plots. `assigned` (plots) as for unlidar::EstimateClutter.
  void EstimateClutter(const std::vector<char>& assigned);

  // (sensors) They refer to this.
  std::vector<StationModel> StationModels() const;

 private:
  void AddStation(const Recording& whole, const Recording& own,
                  const std::vector<std::uint32_t>& frames, const RobustConfig& config);
  void SortByTime();

  Stations stations_;
  PlotConfig config_;
  std::size_t num_sensors_;
  std::vector<Background> backgrounds_;  // (stations)
  std::vector<Plot> plots_;
  std::vector<char> are_static_floating_;
  std::vector<char> are_bodies_;
  std::size_t num_unexplained_ = 0;
};

}  // namespace unlidar
