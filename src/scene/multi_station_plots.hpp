// Scene of each station of a recording, and the plots of all stations together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/station_scene.hpp"
#include "scene/stations.hpp"
#include "scene/time_bins.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Every station is processed with a scene and plots of its own, because ranges, directions and
// occlusion are relative to its viewpoint, and a place that one station sees well may be too seldom
// exposed for another to classify it. The scene of a recording is learned from all of its frames
// before the plots of the first one are found.
class MultiStationPlots {
 public:
  // `config` must outlive it.
  MultiStationPlots(const Recording& recording, const Stations& stations,
                    const RobustConfig& config);

  // Plots of all stations, in the common coordinate frame, frame by frame in order of time.
  const std::vector<Plot>& plots() const { return plots_; }

  // Bodies of all stations, in the common coordinate frame and in order of time.
  const Queue<BodyBox>& bodies() const { return bodies_; }

  // (returns) 1 for returns of bodies.
  const std::vector<char>& are_bodies() const { return are_bodies_; }

  std::size_t num_unexplained() const { return num_unexplained_; }

  // Sets log_clutter of all plots. `assigned` (plots): see unlidar::EstimateClutter.
  void EstimateClutter(const std::vector<char>& assigned);

  // Returns one model per sensor; they point into this object.
  std::vector<StationModel> StationModels() const;

 private:
  struct Station {
    TimeBins bins;
    StationScene scene;
    Queue<BodyBox> bodies;    // in order of time, relative to the viewpoint
    std::vector<Plot> plots;  // relative to the viewpoint
    std::size_t num_frames = 0;
    std::size_t num_frames_done = 0;  // whose plots have been found
  };

  void LoadFrame(const Recording& recording, const FrameInfo& frame);
  void FindPlots(const Recording& recording, std::uint32_t frame_index);
  static void Reserve(std::size_t num_more, Station* station);
  void TakePlots(const Recording& recording, std::size_t station_index);

  const RobustConfig& config_;
  Stations stations_;
  std::size_t num_sensors_;
  std::deque<Station> scenes_;  // (stations)
  Recording frame_;             // the one in progress alone
  std::vector<Plot> plots_;
  Queue<BodyBox> bodies_;
  std::vector<char> are_bodies_;
  std::size_t num_unexplained_ = 0;
};

}  // namespace unlidar
