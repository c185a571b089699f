#include "unlidar/track_recording.hpp"

#include <limits>
#include <utility>

#include "unlidar/engine.hpp"

namespace unlidar {
namespace {

// Each track is reported before its rows; ids count from 0.
struct Collector {
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

}  // namespace

std::vector<Track> TrackRecording(const Config& config, const std::vector<std::string>& sensors,
                                  std::vector<Frame> frames, const OutputTimes& output_times) {
  Config endless = config;
  endless.live.delay_s = std::numeric_limits<double>::infinity();
  std::vector<Track> tracks;
  Engine engine(
      endless, sensors, [&](const EngineEvent& event) { std::visit(Collector{tracks}, event); },
      output_times);
  for (Frame& frame : frames) engine.Add(std::move(frame));
  engine.Close();
  return tracks;
}

}  // namespace unlidar
