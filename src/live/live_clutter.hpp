// Clutter intensity at each plot of a stream, and unsupported static plots.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/queue.hpp"
#include "live/live_plot.hpp"
#include "scene/clutter_map.hpp"
#include "scene/static_places.hpp"
#include "scene/support.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Same as EstimateClutter and MarkFloating of a recording, from the plots of the last `window_s`.
class LiveClutter {
 public:
  LiveClutter(const RobustConfig& config, double window_s);

  // Adds a frame of the warm-up before any frame is judged: later plots are evidence of clutter,
  // too.
  void AddLookahead(std::uint32_t sensor, std::uint32_t bin, const std::vector<LivePlot>& plots);

  // Sets is_floating and the clutter intensity of the plots of one frame, then adds the frame
  // unless it was added as a lookahead.
  void Judge(const Support& support, std::uint32_t sensor, std::uint32_t bin,
             std::vector<LivePlot>* plots);

  // `is_blinded`: a sensor is or may be blinded. No plot is marked as floating then, because its
  // support may be hidden.
  void SetBlinded(bool is_blinded) { is_blinded_ = is_blinded; }

  // Removes a plot of a target from the clutter.
  void RemoveFromClutter(const LivePlot& seen);

  // Forgets all before a bin after a change of weather. No effect with an endless window, which
  // forgets nothing.
  void Restart(std::uint32_t bin);

  // Forgets what is older than the window. To be called periodically.
  void Sweep(std::uint32_t newest_bin);

 private:
  // Frames of a sensor by bin.
  struct FrameCount {
    std::uint32_t bin;
    std::uint32_t count;
  };

  struct Sensor {
    RangeGrid places;  // its plots
    Queue<FrameCount> frames{};
  };

  struct StaticPlot {
    TimeNs time_ns = 0;
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  };

  Sensor& SensorAt(std::uint32_t sensor);
  static std::uint32_t CountFrames(const Sensor& sensor, BinRange bins);
  void AddFrame(std::uint32_t sensor, std::uint32_t bin, const std::vector<LivePlot>& plots);
  void MarkFloating(const Support& support, std::uint32_t bin, std::uint32_t recent_frames,
                    std::vector<LivePlot>* plots);
  void Forget(std::uint32_t before_bin);

  RangeRadius place_;
  double window_bins_;
  std::size_t num_levels_;  // of the clutter map
  bool is_blinded_ = false;
  std::uint32_t lookahead_frames_ = 0;  // that are not judged yet
  std::uint32_t forgotten_bins_ = 0;    // earlier ones are forgotten
  std::vector<Sensor> sensors_;
  ClutterMap clutter_;
  ClutterMap along_;  // the plots of sensors that travel, in the axes of their carriers
  StaticPlaces static_places_;
  NeighbourTest neighbour_test_;
  Queue<StaticPlot> static_plots_;  // of the same time
};

}  // namespace unlidar
