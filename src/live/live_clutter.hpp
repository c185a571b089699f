// Clutter intensity at each plot of a stream, and unsupported static plots.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/queue.hpp"
#include "live/fading_grid.hpp"
#include "live/live_plot.hpp"
#include "recording/robust.hpp"

namespace unlidar {

// Same as EstimateClutter and MarkFloating of a recording, from the plots so far, fading over
// `fade_s`. The last second or so is excluded, because it may be the target's own.
class LiveClutter {
 public:
  LiveClutter(const RobustConfig& config, double fade_s);

  // Adds the plots of a warm-up frame, in order of time and before any frame is judged: during the
  // warm-up later plots are evidence of clutter, too.
  void AddLookahead(std::uint32_t sensor, double time_s, const std::vector<LivePlot>& plots);

  // Counts a frame of a sensor, with or without plots.
  void AddFrame(std::uint32_t sensor, double time_s);

  // Sets is_floating and the clutter intensity of each plot of one frame, then stores the plots.
  void Judge(const Support& support, double time_s, std::vector<LivePlot>* plots);

  // `is_blinded`: a sensor is or may be blinded. No plot is marked as floating then, because its
  // support may be hidden.
  void SetBlinded(bool is_blinded) { is_blinded_ = is_blinded; }

  // Removes a plot of a target from the clutter. Only plots of the last second can be removed.
  void RemoveFromClutter(const Plot& plot);

  // Down-weights all past counts after a change of weather. No effect with an endless window,
  // which forgets nothing.
  void Discount();

  void Sweep(double time_s);

 private:
  struct Recent {
    double time_s = 0.0;
    std::uint32_t frame = 0;
    std::uint32_t sensor = 0;
    Eigen::Vector3f position_m = Eigen::Vector3f::Zero();
  };

  struct Sensor {
    FadingGrid wide;
    FadingGrid middle;
    FadingGrid narrow;
    FadingGrid spot;
    FadingGrid recent_plots;     // plots of the last few seconds,
    double recent_frames = 0.0;  // and frames, faded, until recent_time_s
    double recent_time_s = 0.0;
    double frames = 0.0;  // faded, all whose plots count as clutter by now
    double time_s = 0.0;
    Queue<double> recent_s{};     // frames whose plots do not yet
    Queue<double> lookahead_s{};  // warm-up frames ahead of the exclusion
    double lookahead_frames = 0.0;
  };

  struct StaticPlot {
    double time_s = 0.0;
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  };

  Sensor& SensorAt(std::uint32_t sensor);
  bool HasNeighbours(const Plot& plot, const SupportConfig& support, double time_s);
  void Settle(double time_s);
  void Count(const Recent& plot, double time_s, double count);

  double exclusion_s_;
  double fade_s_;
  bool is_blinded_ = false;
  double discount_s_ = 0.0;  // added to all times, so that past counts fade
  RangeRadius place_;
  std::vector<Sensor> sensors_;
  Queue<Recent> recent_;
  Queue<Recent> lookahead_;  // warm-up plots ahead of the exclusion
  double lookahead_begin_s_ = 0.0;
  double lookahead_end_s_ = -1.0;
  FadingGrid static_grid_;          // plots at a place,
  FadingGrid surroundings_;         // and in its surroundings
  Queue<StaticPlot> static_plots_;  // of the last kSimultaneousS
  // Floating plots, and the simultaneous static plots within the size of a body, within reach, and
  // farther away.
  FadingGrid floating_;
  FadingGrid self_;
  FadingGrid neighbours_;
  FadingGrid outer_;
};

}  // namespace unlidar
