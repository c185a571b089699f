// The scene of a stream: from the returns of a frame to the plots that it does not explain.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "base/queue.hpp"
#include "io/frame_preparation.hpp"
#include "live/live_clutter.hpp"
#include "live/live_plot.hpp"
#include "live/occupancy.hpp"
#include "scene/field_of_view.hpp"
#include "scene/ground.hpp"
#include "scene/stations.hpp"
#include "scene/support.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// A frame, as the scene leaves it.
struct SceneFrame {
  FrameInfo info;
  double time_s = 0.0;          // of its middle, since the first frame began
  double observed_s = 0.0;      // until then, since the youngest station began
  bool is_searched = false;     // or it only told of clutter: its station was hardly warm
  std::vector<LivePlot> plots;  // in the common frame, judged
};

// So long a stream is only looked at before what it shows can be judged by what is known of it.
inline constexpr TimeNs kWarmUpNs = 3'000'000'000;

// What each station knows of its surroundings grows with every frame. A frame is taken, waits until
// its station is warm, is made into plots, and is held until bodies beside them have shown.
class LiveScene {
 public:
  // `config` outlives it.
  explicit LiveScene(const Config& config);

  // Returns the viewpoint of its station, in the common frame. A sensor may be told again.
  Eigen::Vector3f AddSensor(std::uint32_t sensor, const Eigen::Vector3f& origin_m);

  // Whether a known target, none if empty, was at a place at `dwell_begin_s` and is there at
  // `time_s`.
  using IsTarget =
      std::function<bool(const Eigen::Vector3f& place_m, double dwell_begin_s, double time_s)>;

  // As LiveClutter::SetBlinded, from the next frame on: weather is that of all sensors.
  void SetBlinded(bool is_blinded);

  // Learns from a frame, of no earlier stamp than all before, and lets it wait. Returns whether its
  // station was warm before it, so that it is time to make plots. Leaves an older frame in its
  // place, whose memory can be used again.
  bool Take(LoadedFrame* frame);

  bool is_warm() const { return is_warm_; }

  // No frame will follow: what is not warm by now never will be, and waits no longer.
  void Close();

  // Frames that wait, and would be made into plots.
  std::size_t num_waiting() const { return waiting_.size(); }

  // Makes the plots of the next frame that waits, of at least one, in a scene that is warm. Returns
  // the middle of the frame.
  TimeNs MakePlots(const IsTarget& is_target = nullptr);

  // Gives the next frame whose middle is at most `until_ns`, if its plots are made; false if there
  // is none. No body that comes later keeps its plots out. The memory of `frame` is used again.
  bool Next(TimeNs until_ns, SceneFrame* frame);

  // Plots of Next() that are a target's are no clutter: see LiveClutter::RemoveFromClutter.
  void RemoveFromClutter(const std::vector<LivePlot>& plots);

  // Forgets what is too old to count. Call it now and then.
  void Sweep(double time_s);

 private:
  // What stands where, as it was known some time ago.
  struct Snapshot {
    explicit Snapshot(const RobustConfig& config);
    Snapshot(const Snapshot&) = delete;
    Snapshot& operator=(const Snapshot&) = delete;

    Ground ground;
    Support support;
  };

  using BinnedFrame = std::pair<LoadedFrame, std::int64_t>;  // and its time bin

  // What snapshots are made in, kept for the next.
  struct Workspace {
    std::vector<Eigen::Vector3f> points_m;
    Ground::Workspace ground;
    Support::Workspace support;
  };

  // What the sensors of one station see, relative to its viewpoint.
  struct Station {
    Station(const Eigen::Vector3f& its_viewpoint_m, const Config& config);

    Eigen::Vector3f viewpoint_m;
    bool has_begun = false;
    TimeNs begin_ns = 0;
    TimeNs search_from_ns = 0;  // what it shows before only tells of clutter
    Occupancy occupancy;
    FieldOfView field_of_view;
    std::unique_ptr<Snapshot> snapshot;            // none before it is warm
    std::vector<BinnedFrame> early;                // frames before, if others are
    std::vector<Eigen::Vector3f> early_returns_m;  // for the lowest elevation
    double lowest_elevation_rad = 0.0;
    LiveClutter clutter;
    Queue<BodyBox> bodies;
  };

  // How many plots the frames of a sensor have recent, and had before.
  struct PlotRate {
    double recent = 0.0;
    double typical = 0.0;
    int frames = 0;
  };

  bool IsSurge(const SceneFrame& frame);
  double SecondsOf(TimeNs time_ns) const;
  double SecondsOfBin(std::int64_t bin) const;
  std::int64_t BinOf(TimeNs time_ns);
  Station& StationOf(std::uint32_t sensor);
  static void Learn(const LoadedFrame& frame, std::int64_t bin, Station* station);
  void WarmUp();
  void WarmUpLate(Station* station);
  void Refit(Station* station);
  void RefitAll();
  void MakePlotsOf(LoadedFrame* loaded, std::int64_t bin, const IsTarget& is_target,
                   SceneFrame* held);
  void AddLookahead();
  void RemoveBodies(SceneFrame* frame);
  void Judge(SceneFrame* frame);

  const Config& config_;

  // Time.
  bool has_begun_ = false;
  TimeNs begin_ns_ = 0;
  TimeNs bin_ns_;
  std::int64_t bin_shift_ = 0;    // bins of pauses that are left out
  std::int64_t newest_slot_ = 0;  // bin without the shift
  TimeNs front_ns_ = 0;           // middle of the newest frame taken

  // What is known.
  Stations stations_;
  std::vector<Station> scenes_;  // (stations)
  bool is_warm_ = false;
  TimeNs learning_since_ns_ = 0;  // when the youngest station began
  TimeNs snapshot_ns_ = 0;
  int num_snapshots_ = 0;
  TimeNs snapshot_interval_ns_;
  Workspace workspace_;

  // Frames on their way.
  Queue<BinnedFrame> waiting_;
  Queue<SceneFrame> held_;              // not yet judged: their plots are relative to the viewpoint
  std::uint32_t num_frames_ = 0;        // made into plots
  std::size_t num_warm_up_frames_ = 0;  // frames that waited for the warm-up and still do
  std::vector<PlotRate> rates_;         // (sensors)

  // What the plots of a frame are made with, kept for the next.
  Recording frame_;
  FramePlotter plotter_;
  std::vector<std::uint32_t> candidates_;
  std::vector<Occupancy::Verdict> verdicts_;  // (returns)
};

}  // namespace unlidar
