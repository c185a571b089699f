// The whole way from frame directories to trajectory rows.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "unlidar/config.hpp"
#include "unlidar/frames.hpp"
#include "unlidar/output_times.hpp"
#include "unlidar/paper.hpp"
#include "unlidar/robust.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// A target with the trajectory fitted to it. Ids count from 0 in order of first evidence.
struct Track {
  int id = 0;
  TimeNs begin_ns = 0;  // first and last evidence
  TimeNs end_ns = 0;
  double score = 0.0;                  // the method's own, see Target
  double length_m = 0.0;               // along the fitted trajectory
  std::vector<std::uint32_t> returns;  // indices into the recording, ascending
  std::vector<TrajectoryRow> rows;     // in time order
};

struct PipelineRequest {
  std::vector<FrameSource> sources;
  OutputTimes output_times;
  bool score_clusters = false;  // the paper's numbers of every global cluster, for --clusters
};

struct StageTime {
  std::string stage;
  double seconds = 0.0;
};

struct PipelineResult {
  Recording recording;
  std::optional<RobustCounts> robust_counts;  // with the robust method
  std::vector<ClusterScore> clusters;         // empty unless asked for or needed by the method
  std::vector<Track> tracks;
  std::vector<StageTime> times;
};

// Called when a stage has ended, with what it found in a few words.
using ProgressCallback = std::function<void(const StageTime&, const std::string& found)>;

PipelineResult RunPipeline(const PipelineRequest& request, const Config& config,
                           const ProgressCallback& progress);

// The same for a recording that is in memory, without cluster scores.
std::vector<Track> TrackRecording(Recording recording, const OutputTimes& output_times,
                                  const Config& config);

}  // namespace unlidar
