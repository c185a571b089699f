#include "api/recording_events.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "recording/pipeline.hpp"

namespace unlidar {

std::vector<Warning> EmitTracksOf(const Recording& recording, const OutputTimes& output_times,
                                  const Config& config, const EngineCallback& on_event) {
  const PipelineResult result = TracksOf(recording, output_times, config);
  std::vector<TrajectoryRow> rows;
  for (const FittedTrack& track : result.tracks) {
    on_event(TrackConfirmed{track.id, track.begin_ns, track.flight.kind});
    const RowStream next = RowsOf(result, track);
    while (const std::optional<TrajectoryRow> row = next()) rows.push_back(*row);
  }
  std::stable_sort(rows.begin(), rows.end(), [](const TrajectoryRow& a, const TrajectoryRow& b) {
    return std::make_pair(a.time_ns, a.track_id) < std::make_pair(b.time_ns, b.track_id);
  });
  const auto kind_of = [&](const TrajectoryRow& row) {
    return result.tracks[static_cast<std::size_t>(row.track_id)].flight.kind;
  };
  for (const TrajectoryRow& row : rows) on_event(RowGiven{row, false, kind_of(row)});
  for (const FittedTrack& track : result.tracks) {
    on_event(
        TrackEnded{track.id, track.end_ns, track.flight.kind, track.row_source.trajectory.minimum});
  }
  return result.warnings;
}

}  // namespace unlidar
