// The stages of a stream: a frame at a time, in order of time, from returns to rows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "io/frame_preparation.hpp"
#include "live/confirmed_tracks.hpp"
#include "live/live_scene.hpp"
#include "live/live_search.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Scene -> plots -> the tracks that they are -> a search through the others -> new tracks; and back
// to the scene only which plots were no clutter. In the first seconds, while the scene is learned,
// a first look goes ahead: a scene and a search of its own, which take what flies alone in the air
// for a track. The whole search goes on with those when it has come as far.
class LiveTracker {
 public:
  LiveTracker(const Config& config, OutputTimes output_times, EngineCallback on_event);
  LiveTracker(const LiveTracker&) = delete;
  LiveTracker& operator=(const LiveTracker&) = delete;

  // `info`: of the sensor with this index, whenever it is new or its period has changed.
  void SetSensor(std::uint32_t sensor, const SensorInfo& info);

  // Whether any sensor is blinded, or may turn out to be, from the next frame on.
  void SetBlinded(bool is_blinded) {
    for (Pass* const pass : {&whole_, ahead_.get()}) {
      if (pass == nullptr) continue;
      pass->scene.SetBlinded(is_blinded);
      pass->search.SetBlinded(is_blinded);
    }
  }

  // Takes a frame, of no earlier stamp than all before. As LiveScene::Take().
  void Take(LoadedFrame* frame);

  // Gives the rows that are due when `newest_ns` is the newest stamp that has come.
  void GiveRows(TimeNs newest_ns);

  // No frame with an earlier stamp than `settled_ns` will come: goes on as far as that tells, and
  // gives the rows that are due at `now_ns`.
  void Advance(TimeNs settled_ns, TimeNs now_ns);

  // No frame will follow.
  void Close(TimeNs newest_ns);

  bool is_warm() const { return whole_.scene.is_warm(); }

  // Whether the first look still goes ahead.
  bool looks_ahead() const { return ahead_ != nullptr; }

  // Tracks of one engine never share a number.
  int next_id() const { return tracks_.next_id(); }
  void NumberFrom(int id) { tracks_.NumberFrom(id); }

 private:
  // One way through the frames.
  struct Pass {
    Pass(const Config& config, Look its_look, TimeNs warm_up_ns);
    Pass(const Pass&) = delete;
    Pass& operator=(const Pass&) = delete;

    Look look;
    LiveScene scene;
    LiveSearch search;
    SceneFrame frame;                                         // the one at hand
    TimeNs searched_ns = std::numeric_limits<TimeNs>::min();  // middle of the newest one searched
    double tidied_s = 0.0;
  };

  void TakeAhead(const LoadedFrame& frame);
  TimeNs HoldNs(Look look) const;
  void MakePlots(Pass* pass, std::size_t most);
  void SearchUntil(Pass* pass, TimeNs until_ns);
  void Search(Pass* pass);
  void Confirm(Pass* pass);

  Config config_;
  Config ahead_config_;  // of the first look
  Pass whole_;
  std::unique_ptr<Pass> ahead_;     // until the other has come as far
  std::vector<char> are_of_begin_;  // (sensors) it has heard them before it was warm
  LoadedFrame copy_;                // of a frame, for it
  ConfirmedTracks tracks_;
};

}  // namespace unlidar
