// The search of a stream: paths of plots that a flying target explains better than clutter.
#pragma once

#include <cstdint>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "live/live_plot.hpp"
#include "live/live_scene.hpp"
#include "live/recent_frame_times.hpp"
#include "tracking/flight.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/rejection.hpp"
#include "tracking/track_model.hpp"
#include "tracking/track_search.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Searches paths, with each motion model, through the recent plots that no track has. The score
// threshold follows from the rate of plots: clutter alone reaches it live.false_alarms_per_hour
// times an hour.
class LiveSearch {
 public:
  // `config` must outlive it.
  explicit LiveSearch(const Config& config) : config_(config) {}
  LiveSearch(const LiveSearch&) = delete;
  LiveSearch& operator=(const LiveSearch&) = delete;

  // May be called again for a sensor whose frame period has changed.
  void SetSensor(std::uint32_t sensor, const SensorInfo& info);

  // `is_blinded`: a sensor is or may be blinded. Weather affects all sensors, and the clutter of
  // every place may have changed.
  void SetBlinded(bool is_blinded) { is_blinded_ = is_blinded; }

  TimeNs shortest_period_ns() const { return ShortestPeriodNs(recent_); }

  const SensorInfo& SensorAt(std::uint32_t sensor) const { return recent_.sensors[sensor]; }

  // Motion models, one for each agility; their addresses never change.
  const std::vector<TrackModel>& models() const { return models_; }

  // Takes the next frame. Returns its frame time, which its plots share.
  const FrameTime& Begin(const SceneFrame& frame);

  // Sets `gains` (plots of the frame begun) to their gains as plots of paths that were refused as
  // near the ground less than a second before; 0 without one. Empty: the rule is off.
  void GetGroundGains(const SceneFrame& frame, std::vector<double>* gains) const;

  // Extends the search to the plots of that frame. `are_free` (plots): true if no track has the
  // plot. Returns the paths that end in this frame and reach the score threshold, best first, valid
  // until the next call.
  const Queue<Path>& Extend(const SceneFrame& frame, const std::vector<char>& are_free);

  // Returns the rule that refused such a path before it grew to what it is, while its verdict
  // stands: kNone if it is to be judged (again).
  Rejection StandingRejection(const Path& path);

  // Lets the verdict on such a path, the last judged, stand for what extends it, until it has grown
  // by a good part. One for want of detections, or on a likelier path, never stands.
  void LetStand(Rejection rejection, const Path& path);

  // Returns such a path without the short stretches of plots that lower its score, valid until the
  // next call.
  const Path& Pruned(const Path& path);

  // Returns the rule that refuses such a path, or a likelier one of the frame that has most of its
  // plots: it is not a drone, or a track has one of its plots; kNone if none does. Sets flight() to
  // its flying part: it may begin on the ground.
  Rejection Judge(const Path& path);

  // Flying part of the path last judged, and the parts before it that were cut off, in order of
  // time.
  const Flight& flight() const { return flight_; }
  const std::vector<PathCut>& cuts() const { return cuts_; }

  // Score threshold of the last frame searched, and that of a track that starts from flight().
  double score_threshold() const { return score_threshold_; }
  double ScoreThresholdOfFlight() const;

  // Returns the flight of the path last judged with its earlier plots, which are taken from now on.
  Flight WithHistory();

  // Sets `scores` (plots of the last frame) to the score of the best path to each, 0 without one.
  void GetScores(std::vector<double>* scores) const;

  // Recent plots, in order of time.
  const RecentPlots& seen() const { return recent_plots_; }

  // Assigns the plots of the path to a track, so that no other path can use them.
  void Take(const Path& path);

  // True if it is time to forget plots, however recent they are: weather makes thousands a second.
  bool IsFull() const;

  // Forgets frames and plots before `oldest_ns`, and the oldest quarter of the plots if it is full.
  // Returns the number of these plots: indices shift.
  std::size_t Forget(TimeNs oldest_ns);

 private:
  // A verdict on the paths to a plot that stands for so many more plots.
  struct StandingVerdict {
    Rejection rejection = Rejection::kNone;
    std::uint32_t num_plots = 0;
  };

  // The rule that refused the last path with a plot, and the scan in which it did.
  struct Refusal {
    std::uint32_t scan = 0;
    Rejection rejection = Rejection::kNone;
  };

  void CountPlots(const SceneFrame& frame);
  double ClutterUncertaintyMargin(double learning_s) const;
  bool IsFree(const Path& path) const;  // no track has one of its plots
  void Refuse(const Members& members, Rejection rejection);
  Rejection RejectionOfLikelier(const Members& members) const;
  void SetPath(const Members& members);  // sets path_plots_
  PathScorer Scorer(TimeOutOfView time_out_of_view) const;
  Members LeftAtPauses() const;
  PathGates Gates() const {  // of path_plots_
    return {Scorer(TimeOutOfView::kNone), score_threshold_, recent_, recent_bodies_,
            config_.robust};
  }
  Flight FlightOf(const Members& members) const;
  Path FollowedBack(const Members& members);
  bool IsCrowded() const;
  double CrowdingPenaltyOfFlight() const;

  const Config& config_;
  ScanSchedule scan_schedule_;
  Recording recent_;  // sensors and recent frames, without returns
  FrameTime frame_time_;
  std::vector<TrackModel> models_;
  RecentPlots recent_plots_;
  Queue<BodyBox> recent_bodies_;           // in order of time
  std::vector<double> log_births_;         // (recent plots)
  std::vector<char> free_;                 // (recent plots)
  std::vector<StandingVerdict> verdicts_;  // (recent plots)
  std::vector<Refusal> refusals_;          // (recent plots)
  std::uint32_t num_scans_ = 0;
  std::vector<TrackSearch> searches_;
  RecentFrameTimes frame_times_;  // of the frames with plots
  // Buffers, reused from frame to frame.
  std::vector<double> birth_odds_;  // (plots of the frame)
  std::vector<Plot> frame_plots_;   // of scan_
  Scan scan_;
  Queue<Path> paths_;
  std::vector<Plot> path_plots_;         // of the path that is looked at
  std::vector<double> path_log_births_;  // (path_plots_)
  Path pruned_;
  Members flight_members_;  // recent plots of flight_
  Flight flight_;
  std::vector<PathCut> cuts_;
  bool is_of_likelier_ = false;  // the verdict of the path last judged
  double odds_ = 0.0;            // sum of birth odds over all plots, faded,
  double num_plots_ = 0.0;       // number of plots, faded,
  double rate_window_s_ = 0.0;   // and time over which they were counted, faded
  double rate_time_s_ = 0.0;     // time of the last count
  double observed_s_ = 0.0;      // SceneFrame::observed_s of the last frame searched
  double score_threshold_ = 0.0;
  bool is_blinded_ = false;
};

}  // namespace unlidar
