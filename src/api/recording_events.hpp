// A recording in memory, tracked at once, as the events of a stream.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"
#include "unlidar/track_recording.hpp"

namespace unlidar {

// Emits the tracks of a recording: all confirmations, the rows in order of time, all ends. Returns
// the warnings about the recording. The RecordingTracker of LiveEngine.
std::vector<Warning> EmitTracksOf(const Recording& recording, const OutputTimes& output_times,
                                  const Config& config, const EngineCallback& on_event);

// The events of a recording as its tracks, each reported before its rows; ids count from 0.
struct TrackCollector {
  std::vector<Track>& tracks;

  void operator()(const TrackConfirmed& track) const {
    tracks.push_back(
        {track.track_id, track.first_evidence_ns, track.first_evidence_ns, track.kind, {}, {}});
  }
  void operator()(const RowGiven& given) const { Of(given.row.track_id).rows.push_back(given.row); }
  void operator()(const TrackEnded& track) const {
    Of(track.track_id).end_ns = track.last_evidence_ns;
    Of(track.track_id).kind = track.kind;
    Of(track.track_id).minimum = track.minimum.value_or(MinimumReport());
  }
  template <class Other>
  void operator()(const Other&) const {}

  Track& Of(int id) const { return tracks[static_cast<std::size_t>(id)]; }
};

}  // namespace unlidar
