// The clutter to be expected at each plot of a stream, and what stands still there.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/queue.hpp"
#include "live/fading_grid.hpp"
#include "live/live_plot.hpp"
#include "recording/robust.hpp"

namespace unlidar {

// As EstimateClutter and MarkFloating say it of a recording, from the plots so far: those of the
// last `fade_s` count, but for the last second or so, which may be the target's own.
class LiveClutter {
 public:
  LiveClutter(const RobustConfig& config, double fade_s);

  // The plots of one of the first frames, in order of time and before any is judged: among those,
  // what comes later tells of clutter, too.
  void AddLookahead(std::uint32_t sensor, double time_s, const std::vector<LivePlot>& plots);

  // A frame of a sensor was taken, whether or not it shows any plot.
  void AddFrame(std::uint32_t sensor, double time_s);

  // Tells of each plot, of one frame, whether it floats and how much clutter is there. Then
  // remembers the plots.
  void Judge(const Support& support, double time_s, std::vector<LivePlot>* plots);

  // Whether a sensor is blinded or may be: then nothing is known to float, as what holds it may not
  // be seen.
  void SetBlinded(bool is_blinded) { is_blinded_ = is_blinded; }

  // A plot that is a target's is no clutter. Only one of the last second can still be told.
  void RemoveFromClutter(const Plot& plot);

  // What was seen until now weighs little against what follows: the weather has changed. Not with
  // an endless window, which forgets nothing.
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
    FadingGrid recent_plots;     // plots of the last moments,
    double recent_frames = 0.0;  // and frames, faded, up to
    double recent_time_s = 0.0;
    double frames = 0.0;  // likewise, all whose plots are clutter by now
    double time_s = 0.0;
    Queue<double> recent_s{};     // frames whose plots are not
    Queue<double> lookahead_s{};  // foreseen frames whose plots are clutter from the other side
    double lookahead_frames = 0.0;
  };

  // A plot that stands still, and when.
  struct StaticPlot {
    double time_s = 0.0;
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  };

  Sensor& SensorAt(std::uint32_t sensor);
  bool HasNeighbours(const Plot& plot, const SupportConfig& support, double time_s);
  void Settle(double time_s);
  void Count(const Recent& plot, double time_s, double count);

  PlotConfig config_;
  double exclusion_s_;
  double fade_s_;
  bool is_blinded_ = false;
  double discount_s_ = 0.0;  // by which all that was seen is older than its time says
  RangeRadius place_;
  std::vector<Sensor> sensors_;
  Queue<Recent> recent_;
  Queue<Recent> lookahead_;  // foreseen, and farther ahead than the exclusion
  double lookahead_begin_s_ = 0.0;
  double lookahead_end_s_ = -1.0;
  FadingGrid static_grid_;          // plots at one place,
  FadingGrid surroundings_;         // and in a wider one
  Queue<StaticPlot> static_plots_;  // of the last moments
  // About each floating plot at the same time: it and what stands as near as its own body, beside
  // it and farther away.
  FadingGrid floating_;
  FadingGrid self_;
  FadingGrid neighbours_;
  FadingGrid outer_;
};

}  // namespace unlidar
