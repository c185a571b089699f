// The scene of a stream: extracts the unexplained plots of each frame.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "io/sensor_frames.hpp"
#include "live/live_plot.hpp"
#include "scene/clutter.hpp"
#include "scene/floating.hpp"
#include "scene/shell_table.hpp"
#include "scene/station_scene.hpp"
#include "scene/stations.hpp"
#include "tracking/rejection.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// A frame after the scene stage.
struct SceneFrame {
  FrameInfo info;
  std::uint32_t bin = 0;
  double time_s = 0.0;      // middle, since the start of the first frame
  double observed_s = 0.0;  // time_s since the youngest station began
  Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();
  // kWarmUp, kSurge: used for clutter only, its station is still learning; otherwise it is searched
  Rejection rejection = Rejection::kNone;
  std::vector<LivePlot> plots;            // in common coordinates, with clutter intensity
  std::vector<BodyBox> bodies;            // in common coordinates
  std::vector<Eigen::Vector3f> bodies_m;  // if traced: returns of bodies, and plots beside them

  bool is_searched() const { return rejection == Rejection::kNone; }
};

// Warm-up: the scene is learned before detections are scored.
inline constexpr TimeNs kWarmUpNs = 3'000'000'000;

// Each station learns its surroundings from every frame. A frame is taken, waits until its station
// is warm, is made into plots, and is held until bodies beside them can be detected.
class LiveScene {
 public:
  // `config` must outlive it. `is_traced`: frames have their bodies.
  explicit LiveScene(const Config& config, bool is_traced = false);

  // May be called again for a sensor.
  void AddSensor(std::uint32_t sensor, const SensorInfo& info);

  // `is_blinded`: a sensor is or may be blinded, and weather affects all. From the next frame on no
  // plot is marked as floating then, because its support may be hidden.
  void SetBlinded(bool is_blinded) { is_blinded_ = is_blinded; }

  // Learns from a frame and queues it. Frames come in order of stamps. Returns true if its station
  // was already warm, so that plots can be made. Swaps in an older frame, whose memory can be
  // reused.
  bool Take(LoadedFrame* frame);

  bool is_warm() const { return is_warm_; }

  // No frame will follow: ends the warm-up.
  void Close() {
    if (has_begun_ && !is_warm_) WarmUp();
  }

  std::size_t num_waiting() const { return waiting_.size(); }

  // Middle of the next waiting frame, since the start of the first frame; one must be waiting.
  double NextTimeS() const { return SecondsSinceBegin(waiting_.front().middle_ns()); }

  // Makes the plots of the next waiting frame and returns the middle of that frame. The scene must
  // be warm and a frame must be waiting. `targets`: at NextTimeS().
  TimeNs MakePlots(const KnownTargets& targets = {});

  // Sets the next frame whose plots are made and whose middle is at most `until_ns`; returns false
  // if there is none. Bodies found later no longer remove its plots. The memory of `frame` is
  // reused.
  bool Next(TimeNs until_ns, SceneFrame* frame);

  // Removes plots of a target, from Next(), from the clutter.
  void RemoveFromClutter(const std::vector<LivePlot>& plots);

  // Erases faded counts. To be called periodically.
  void Sweep(std::uint32_t newest_bin);

 private:
  // A frame that was learned and waits for its plots.
  struct WaitingFrame {
    Recording frame;          // of this one frame
    std::size_t station = 0;  // that learned it: the sensor may have been replaced since
    std::int64_t bin = 0;
    OwnVoxels voxels;

    TimeNs middle_ns() const { return frame.frames.front().middle_ns(); }
  };

  // State of one station, relative to its viewpoint.
  struct Station {
    Eigen::Vector3f viewpoint_m;
    StationScene scene;  // fitted when it is warm
    ClutterModel clutter;
    FloatingPlots floating;
    bool has_begun = false;
    TimeNs begin_ns = 0;
    TimeNs search_from_ns = 0;                // earlier frames are used for clutter only,
    Rejection learning = Rejection::kWarmUp;  // for this reason
    std::size_t num_lookahead_frames = 0;     // in the clutter and not judged yet
    Queue<BodyBox> bodies = {};
  };

  // Mean number of plots per frame of a sensor.
  struct PlotRate {
    double recent = 0.0;
    double typical = 0.0;  // long-term
    double known = 0.0;    // the most that was typical, forgotten with the window
    int frames = 0;
    double time_s = 0.0;  // of the last frame
  };

  bool IsSurge(const SceneFrame& frame);
  double SecondsSinceBegin(TimeNs time_ns) const { return SecondsOf(time_ns - begin_ns_); }
  // Time of the middle of a bin, exact if no pause has been skipped since.
  double SecondsOfBin(std::int64_t bin) const {
    return (static_cast<double>(bin + bin_shift_) + 0.5) * kBinS;
  }
  std::int64_t BinOf(TimeNs time_ns);
  Station& StationOf(std::uint32_t sensor) { return scenes_[stations_.StationOf(sensor)]; }
  void WarmUp();
  void WarmUpLate(Station* station);
  void Refit();
  void Enqueue(std::int64_t bin, LoadedFrame* frame);
  void MakePlotsOf(WaitingFrame* waiting, const KnownTargets& targets, SceneFrame* held);
  void AddLookahead();
  static void AddToClutter(const SceneFrame& frame, Station* station);
  void RemoveBodies(SceneFrame* frame);
  void Judge(SceneFrame* frame);
  void JudgePlots(SceneFrame* frame, Station* station);

  const Config& config_;
  bool is_traced_;

  // Time.
  bool has_begun_ = false;
  TimeNs begin_ns_ = 0;
  std::int64_t bin_shift_ = 0;    // bins skipped in pauses
  std::int64_t newest_slot_ = 0;  // bin without the shift
  TimeNs front_ns_ = 0;           // middle of the newest frame taken

  // Scene.
  Stations stations_;
  std::deque<Station> scenes_;  // (stations)
  bool is_warm_ = false;
  bool is_blinded_ = false;
  TimeNs learning_since_ns_ = 0;  // start of the youngest station, or the last surge
  TimeNs snapshot_ns_ = 0;
  TimeNs snapshot_interval_ns_;
  bool are_grounds_new_ = false;  // supports are due

  // Frames in progress.
  OwnVoxels voxels_;  // of the frame learned last
  Queue<WaitingFrame> waiting_;
  Queue<SceneFrame> held_;              // not yet judged; plots are relative to the viewpoint
  std::uint32_t num_frames_ = 0;        // with plots
  std::size_t num_warm_up_frames_ = 0;  // frames of the warm-up that still wait
  std::vector<PlotRate> rates_;         // (sensors)
};

}  // namespace unlidar
