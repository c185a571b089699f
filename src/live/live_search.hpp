// The search of a stream: which paths of plots only a flying target explains.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "live/live_plot.hpp"
#include "live/live_scene.hpp"
#include "live/recent_frame_times.hpp"
#include "tracking/track_model.hpp"
#include "tracking/track_search.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Paths are searched, with each model of motion, through the plots of the last while that no track
// has. What they must reach follows from how many plots are seen: clutter alone reaches it
// live.false_alarms_per_hour times an hour.
class LiveSearch {
 public:
  // `config` outlives it.
  explicit LiveSearch(const Config& config) : config_(config) {}
  LiveSearch(const LiveSearch&) = delete;
  LiveSearch& operator=(const LiveSearch&) = delete;

  // `viewpoint_m`: of its station. A sensor may be told again, with another period.
  void SetSensor(std::uint32_t sensor, const SensorInfo& info, const Eigen::Vector3f& viewpoint_m);

  // Whether a sensor is blinded or may be: weather is that of all, and the clutter of no place is
  // as it was.
  void SetBlinded(bool is_blinded) { is_blinded_ = is_blinded; }

  // As ShortestPeriodNs, of these sensors.
  TimeNs shortest_period_ns() const { return ShortestPeriodNs(recent_); }

  // Of the motion of targets, one for each agility; where they are never changes.
  const std::vector<TrackModel>& models() const { return models_; }

  // Takes the next frame. Returns its moment, which is that of its plots.
  const FrameTime& Begin(const SceneFrame& frame);

  // Goes on to the plots of that frame. `are_free` (plots): those that no track has. Returns the
  // paths that end with one of them and reach a least score, the best first, until the next call.
  const Queue<Path>& Extend(const SceneFrame& frame, const std::vector<char>& are_free);

  // What a track that begins with a path must reach, whose flight was the last that was asked for,
  // as of the last frame that was searched.
  double ScoreThresholdOf(const Path& path) const;

  // What flies of such a path, which may have come from something on the ground; until the next
  // call. Null if that is no drone, or if another path took any of its plots.
  const Flight* FlightOf(const Path& path);

  // That flight with what it was before the search found it, which is the track's from now on.
  Flight WithHistory(const Flight& flight);

  // What was seen in the last while, in order of time.
  const std::vector<LivePlot>& seen() const { return recent_plots_; }

  // The plots of the path are a track's, and no other path's.
  void Take(const Path& path);

  // Forgets what was seen before.
  void Forget(TimeNs oldest_ns);

 private:
  void CountPlots(const SceneFrame& frame);
  double ScoreThreshold() const;
  double ClutterUncertaintyMargin(double learning_s) const;
  bool IsCrowded(const Path& path) const;

  const Config& config_;
  ScanSchedule scan_schedule_;
  Recording recent_;  // sensors and frames of the last while, without returns
  FrameTime frame_time_;
  std::vector<TrackModel> models_;
  std::vector<Plot> plots_;
  std::vector<LivePlot> recent_plots_;  // the same
  std::vector<double> log_births_;      // (plots)
  std::vector<char> free_;              // (plots)
  std::vector<TrackSearch> searches_;
  RecentFrameTimes frame_times_;  // of the frames with plots
  // What a frame is worked on with, kept for the next.
  std::vector<double> birth_odds_;  // (plots)
  Scan scan_;
  Queue<Path> paths_;
  Flight flight_;
  std::vector<Plot> flight_plots_;
  double odds_ = 0.0;           // sum over all plots, faded,
  double num_plots_ = 0.0;      // and their number,
  double rate_window_s_ = 0.0;  // and how long that took
  double rate_time_s_ = 0.0;    // when
  double observed_s_ = 0.0;     // for how long what is searched was watched
  double score_threshold_ = 0.0;
  bool is_blinded_ = false;
};

}  // namespace unlidar
