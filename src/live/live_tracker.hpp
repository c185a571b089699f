// The stages of a stream: a frame at a time, in order of time, from returns to rows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "io/frame_preparation.hpp"
#include "live/confirmed_tracks.hpp"
#include "live/live_scene.hpp"
#include "live/live_search.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Scene -> plots -> the tracks that they are -> a search through the others -> new tracks; and back
// to the scene only which plots were no clutter. The frames of the first seconds wait until the
// scene is learned, and are searched then.
class LiveTracker {
 public:
  LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event);
  LiveTracker(const LiveTracker&) = delete;
  LiveTracker& operator=(const LiveTracker&) = delete;

  // `info`: of the sensor with this index, whenever it is new or its period has changed.
  void SetSensor(std::uint32_t sensor, const SensorInfo& info);

  // Whether any sensor is blinded, or may turn out to be, from the next frame on.
  void SetBlinded(bool is_blinded) {
    scene_.SetBlinded(is_blinded);
    search_.SetBlinded(is_blinded);
  }

  // Takes a frame, of no earlier stamp than all before. As LiveScene::Take().
  void Take(LoadedFrame* frame);

  // Gives the rows that are due when `newest_ns` is the newest stamp that has come.
  void EmitRows(TimeNs newest_ns);

  // No frame with an earlier stamp than `settled_ns` will come: goes on as far as that tells, and
  // gives the rows that are due at `now_ns`.
  void Advance(TimeNs settled_ns, TimeNs now_ns);

  // No frame will follow.
  void Close(TimeNs newest_ns);

  bool is_warm() const { return scene_.is_warm(); }

  // Tracks of one engine never share a number.
  int next_id() const { return tracks_.next_id(); }
  void NumberFrom(int id) { tracks_.NumberFrom(id); }

 private:
  void MakePlots(std::size_t max_frames);
  void SearchUntil(TimeNs until_ns);
  void Search();
  void Confirm();

  Config config_;
  LiveScene scene_;
  LiveSearch search_;
  ConfirmedTracks tracks_;
  SceneFrame frame_;                                         // the one at hand
  TimeNs searched_ns_ = std::numeric_limits<TimeNs>::min();  // middle of the newest one searched
  double cleaned_up_s_ = 0.0;
};

}  // namespace unlidar
