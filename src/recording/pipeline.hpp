// The pipeline from frame directories to trajectory rows.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/recording.hpp"
#include "io/frames.hpp"
#include "paper/paper.hpp"
#include "recording/robust.hpp"
#include "trajectory/kind.hpp"
#include "trajectory/sampling.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Return rate and extent of a target. Informative only, not used for the kind: drones and birds of
// one size reflect alike.
struct ReturnStatistics {
  double echo_m2_per_s = 0.0;  // return rate: returns per second times range^2
  double extent_m = 0.0;       // RMS distance of the returns from the trajectory, across the ray
};

// A target with the rows of its trajectory. Ids count from 0 in order of first evidence.
struct FittedTrack {
  double score = 0.0;                  // of the method, see Target
  double length_m = 0.0;               // along the fitted trajectory
  std::vector<std::uint32_t> returns;  // indices into the recording, ascending
  RowSource row_source;
  std::size_t num_rows = 0;
  FlightStatistics flight;
  ReturnStatistics echo;

  int id() const { return row_source.track_id; }
  TimeNs begin_ns() const { return row_source.trajectory.begin_ns(); }  // first and last evidence
  TimeNs end_ns() const { return row_source.trajectory.end_ns(); }
};

struct PipelineRequest {
  std::vector<FrameSource> sources;
  OutputTimes output_times;
  bool are_times_whole = false;       // a list of whole numbers, possibly frame numbers
  bool score_clusters = false;        // the paper's numbers of every global cluster, for --clusters
  double max_bird_probability = 1.0;  // tracks above it are left out
  TraceSink trace;                    // of the robust method; may be none
};

struct StageTime {
  std::string stage;
  double seconds = 0.0;
};

struct PipelineResult {
  Recording recording;                        // with the robust method, the returns of tracks only
  std::optional<RobustCounts> robust_counts;  // with the robust method
  std::vector<ClusterScore> clusters;         // empty unless asked for or needed by the method
  std::vector<FittedTrack> tracks;
  std::size_t tracks_left_out = 0;  // for max_bird_probability; the others keep their ids
  OutputInstants output_instants;   // at which the tracks have rows
  std::vector<Warning> warnings;
  std::vector<double> blinded_s;  // for how long each sensor was, see SensorHealth
  std::vector<double> sway_deg;   // largest amplitude of each, see Sway
  std::vector<StageTime> times;
};

// The rows of one of the result's tracks; the result must outlive them.
inline RowStream RowsOf(const PipelineResult& result, const FittedTrack& track) {
  return [rows = RowSampler(track.row_source, result.output_instants)]() mutable {
    return rows.Next();
  };
}

// Called at the end of a stage, with a short text of its result.
using ProgressCallback = std::function<void(const StageTime&, const std::string& found)>;

PipelineResult RunPipeline(const PipelineRequest& request, const Config& config,
                           const ProgressCallback& progress);

// Same for an in-memory recording, without cluster scores.
PipelineResult TracksOf(const Recording& recording, const OutputTimes& output_times,
                        const Config& config);

}  // namespace unlidar
