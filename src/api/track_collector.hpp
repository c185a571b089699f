// The events of a recording as its tracks.
#pragma once

#include <vector>

#include "unlidar/engine.hpp"
#include "unlidar/track_recording.hpp"

namespace unlidar {

// Visitor of events. Each track is reported before its rows; ids count from 0.
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
  void operator()(const TrackPredicted&) const {}
  void operator()(const SensorChanged&) const {}
  void operator()(const EngineState&) const {}

  Track& Of(int id) const { return tracks[static_cast<std::size_t>(id)]; }
};

}  // namespace unlidar
