// The stages of a stream from returns to rows, frame by frame in order of time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "io/sensor_frames.hpp"
#include "live/confirmed_tracks.hpp"
#include "live/live_scene.hpp"
#include "live/live_search.hpp"
#include "live/live_trace.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Scene -> plots -> extension of tracks -> search through the free plots -> new tracks. The only
// feedback to the scene are the plots to remove from the clutter. Frames of the warm-up wait until
// the scene is learned, and are searched then.
class LiveTracker {
 public:
  // `trace` may be empty.
  LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event,
              LiveTraceSink trace = nullptr);
  LiveTracker(const LiveTracker&) = delete;
  LiveTracker& operator=(const LiveTracker&) = delete;

  // To be called for a new sensor and whenever its frame period has changed.
  void SetSensor(std::uint32_t sensor, const SensorInfo& info);

  // `is_blinded`: a sensor is or may be blinded, from the next frame on.
  void SetBlinded(bool is_blinded) {
    scene_.SetBlinded(is_blinded);
    search_.SetBlinded(is_blinded);
  }

  // Takes a frame. Frames come in order of stamps. Swaps `frame` as LiveScene::Take() does.
  void Take(LoadedFrame* frame);

  // Emits the rows that are due when `newest_ns` is the newest stamp.
  void EmitRows(TimeNs newest_ns) {
    scene_.RemoveFromClutter(tracks_.EmitRows(searched_ns_, newest_ns));
  }

  // The next two: same as those of ConfirmedTracks.
  void Predict(TimeNs newest_ns) { tracks_.Predict(newest_ns); }
  void ContinueNumbers(const LiveTracker& earlier) { tracks_.ContinueNumbers(earlier.tracks_); }

  // Searches as far as possible, given that no frame with a stamp before `settled_ns` will follow,
  // and emits the rows that are due at `now_ns`.
  void Advance(TimeNs settled_ns, TimeNs now_ns);

  // Searches the remaining frames, emits all rows and ends all tracks.
  void Close(TimeNs newest_ns);

  bool is_warm() const { return scene_.is_warm(); }

 private:
  void MakePlots(std::size_t max_frames);
  void SearchUntil(TimeNs until_ns) {
    while (scene_.Next(until_ns, &frame_)) Search();
  }
  void Search();
  void Confirm();
  PathVerdict Decide(const Path& path);
  void TraceFrame();

  Config config_;
  LiveTrace trace_;
  LiveScene scene_;
  LiveSearch search_;
  ConfirmedTracks tracks_;
  SceneFrame frame_;                                         // current one
  TimeNs searched_ns_ = std::numeric_limits<TimeNs>::min();  // middle of the newest frame searched
  double cleaned_up_s_ = 0.0;
  std::vector<double> ground_gains_;  // (plots of frame_)
  std::vector<double> scores_;        // (plots of frame_) of the best path to each, if traced
};

}  // namespace unlidar
