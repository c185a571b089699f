// The stages of a stream: a frame at a time, in order of time, from returns to rows.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "io/frame_preparation.hpp"
#include "live/live_clutter.hpp"
#include "live/occupancy.hpp"
#include "live/track_follower.hpp"
#include "robust/scene/field_of_view.hpp"
#include "robust/scene/ground.hpp"
#include "robust/scene/stations.hpp"
#include "robust/scene/support.hpp"
#include "robust/tracking/track_search.hpp"
#include "trajectory/kind.hpp"
#include "trajectory/output_times.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// What stands where, as it was known some time ago.
struct SceneSnapshot {
  SceneSnapshot(std::vector<Eigen::Vector3f> points_m, const ElevationRange& view,
                const RobustConfig& config);

  std::vector<Eigen::Vector3f> structure_m;
  Ground ground;
  Support support;
};

class LiveTracker {
 public:
  LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event);
  ~LiveTracker();

  // `info`: of the sensor with this index, whenever it is new or its period has changed.
  void SetSensor(std::uint32_t sensor, const SensorInfo& info);

  // Takes a frame, of no earlier stamp than all before.
  void Take(LoadedFrame frame);

  // Gives the rows that are due when `newest_ns` is the newest stamp that has come.
  void GiveRows(TimeNs newest_ns);

  // No frame with an earlier stamp than `settled_ns` will come: goes on as far as that tells, and
  // gives the rows that are due at `now_ns`.
  void Advance(TimeNs settled_ns, TimeNs now_ns);

  // No frame will follow.
  void Close(TimeNs newest_ns);

  bool is_warm() const { return is_warm_; }

 private:
  // What the sensors of one station see, relative to its viewpoint.
  struct Station {
    Station(const Eigen::Vector3f& its_viewpoint_m, const Config& config);

    Eigen::Vector3f viewpoint_m;
    bool has_begun = false;
    TimeNs begin_ns = 0;
    TimeNs search_from_ns = 0;  // what it shows before only tells of clutter
    Occupancy occupancy;
    FieldOfView view;
    std::unique_ptr<SceneSnapshot> snapshot;                 // none before it is warm
    std::deque<std::pair<LoadedFrame, std::int64_t>> early;  // frames before, if others are
    std::vector<Eigen::Vector3f> early_returns_m;            // for the lowest elevation
    double lowest_elevation_rad = 0.0;
    LiveClutter clutter;
    std::deque<BodyBox> bodies;
  };

  // A frame whose plots are not yet judged: a body may still show itself beside them. They are
  // relative to the viewpoint.
  struct HeldFrame {
    FrameInfo info;
    std::vector<SeenPlot> plots;
    std::vector<double> place_rates;  // (plots)
  };

  struct Output {
    std::unique_ptr<TrackFollower> track;
    KindFilter kind;
    TimeNs given_ns = 0;  // up to here
    bool is_told = false;
  };

  std::int64_t BinOf(TimeNs time_ns);
  double SecondsOf(TimeNs time_ns) const;
  Station& StationOf(const FrameInfo& frame);
  static void Learn(const LoadedFrame& frame, std::int64_t bin, Station* station);
  void WarmUp();
  void WarmUpLate(LoadedFrame frame, std::int64_t bin, Station* station);
  void Refit(Station* station);
  void MakeEarlyPlots(std::size_t most);
  void RefitScene();
  void MakePlots(LoadedFrame frame, std::int64_t bin);
  void StepHeld(TimeNs until_ns);
  void Step(HeldFrame held);
  void Confirm();
  void ConfirmPath(const Path& path, double threshold);
  void Tidy(double time_s);
  void AddInstants(const FrameInfo& frame);
  void GiveRowsOf(Output* output, TimeNs limit_ns, TimeNs newest_ns);
  int SupportAt(const TrackFollower& track, std::size_t instant) const;

  Config config_;
  OutputTimes output_times_;
  EngineCallback on_event_;

  // Time.
  bool has_begun_ = false;
  TimeNs begin_ns_ = 0;
  TimeNs bin_ns_;
  std::int64_t bin_shift_ = 0;    // bins of pauses that are left out
  std::int64_t newest_slot_ = 0;  // bin without the shift
  TimeNs front_ns_ = 0;           // middle of the newest frame taken,
  TimeNs stepped_ns_ = 0;         // and of the newest one that was searched

  // Scene.
  Stations stations_;
  std::vector<Station> scenes_;  // (stations)
  bool is_warm_ = false;
  TimeNs learning_since_ns_ = 0;  // when the youngest station began
  TimeNs snapshot_ns_ = 0;
  int num_snapshots_ = 0;
  TimeNs snapshot_interval_ns_ = 0;
  std::deque<std::pair<LoadedFrame, std::int64_t>> early_;  // frames before it is warm

  // Plots.
  std::deque<HeldFrame> held_;
  std::uint32_t num_frames_ = 0;

  // Search.
  Watch watch_;
  Recording recent_;  // sensors and frames of the last while, without returns
  Moment moment_;
  std::vector<TrackModel> models_;
  std::vector<Plot> plots_;
  std::vector<SeenPlot> seen_;  // the same
  std::vector<double> log_births_;
  std::vector<char> free_;
  std::vector<TrackSearch> searches_;
  double odds_ = 0.0;       // sum over the plots, faded,
  double num_plots_ = 0.0;  // and their number,
  double watched_s_ = 0.0;  // and how long that took
  double rates_s_ = 0.0;    // when
  double tidied_s_ = 0.0;

  // Tracks.
  int next_id_ = 0;
  std::vector<Output> outputs_;
  std::deque<TimeNs> instants_;
  std::optional<OutputInstants> rate_instants_;  // computed one by one, without an end
  std::size_t next_instant_ = 0;                 // of a rate or a list
};

}  // namespace unlidar
