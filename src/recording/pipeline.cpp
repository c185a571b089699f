#include "recording/pipeline.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include "base/format.hpp"

namespace unlidar {
namespace {

// Runs one stage after the other and takes their times.
class StageTimer {
 public:
  StageTimer(const ProgressCallback& progress, std::vector<StageTime>& times)
      : progress_(progress), times_(times) {}

  // Ends the stage that began with the end of the one before.
  void End(const std::string& stage, const std::string& found) {
    const auto now = std::chrono::steady_clock::now();
    times_.push_back({stage, std::chrono::duration<double>(now - begin_).count()});
    begin_ = now;
    progress_(times_.back(), found);
  }

 private:
  const ProgressCallback& progress_;
  std::vector<StageTime>& times_;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

// Tracks are numbered in this order.
bool IsSeenEarlier(const Target& a, const Target& b) {
  const auto key = [](const Target& target) {
    return std::make_pair(target.measurements.front().time_ns, target.returns);
  };
  return key(a) < key(b);
}

FittedTrack FitTrack(const Recording& recording, const Target& target,
                     const TrajectoryConfig& config) {
  FittedTrack track;
  RowSource& rows = track.row_source;
  rows.trajectory = FitTrajectory(target.measurements, config);
  rows.presence = PresenceInterval(recording, target.measurements, config.silence_probability);
  rows.depth_sigma_m = target.depth_sigma_m;
  rows.max_sigma_m = config.max_sigma_m;
  rows.support = SupportByFrame(recording, target.returns);
  track.begin_ns = rows.trajectory.begin_ns();
  track.end_ns = rows.trajectory.end_ns();
  track.score = target.score;
  track.length_m = PathLength(rows.trajectory);
  track.returns = target.returns;
  return track;
}

std::size_t CountRows(const RowStream& next) {
  std::size_t count = 0;
  while (next()) ++count;
  return count;
}

// All stages behind the reading; result.recording is there.
void FindTracks(const PipelineRequest& request, const Config& config, StageTimer& timer,
                PipelineResult& result) {
  const Recording& recording = result.recording;

  std::vector<Target> targets;
  if (config.method == Method::kPaper) {
    targets = FindTargetsPaper(recording, config.paper, &result.clusters);
  } else {
    RobustResult robust = FindTargetsRobust(recording, config.robust, config.trajectory);
    targets = std::move(robust.targets);
    result.robust_counts = robust.counts;
  }
  std::sort(targets.begin(), targets.end(), IsSeenEarlier);
  timer.End("targets", Count(targets.size(), "target"));

  if (request.score_clusters && config.method != Method::kPaper) {
    result.clusters = ScoreClusters(recording, config.paper);
    timer.End("clusters", Count(result.clusters.size(), "cluster"));
  }

  result.output_instants = ResolveOutputTimes(request.output_times, recording);
  for (const Target& target : targets) {
    FittedTrack track = FitTrack(recording, target, config.trajectory);
    track.id = track.row_source.track_id = static_cast<int>(result.tracks.size());
    track.num_rows = CountRows(RowsOf(result, track));
    result.tracks.push_back(std::move(track));
  }
  timer.End("trajectories", Count(result.tracks.size(), "track"));
}

}  // namespace

PipelineResult RunPipeline(const PipelineRequest& request, const Config& config,
                           const ProgressCallback& progress) {
  PipelineResult result;
  StageTimer timer(progress, result.times);
  result.recording = ReadRecording(request.sources, config.input, config.sensors);
  timer.End("read", Count(result.recording.frames.size(), "frame") + ", " +
                        Count(result.recording.points_m.size(), "return"));
  FindTracks(request, config, timer, result);
  return result;
}

PipelineResult TracksOf(Recording recording, const OutputTimes& output_times,
                        const Config& config) {
  PipelineRequest request;
  request.output_times = output_times;
  PipelineResult result;
  result.recording = std::move(recording);
  const ProgressCallback quiet = [](const StageTime&, const std::string&) {};
  StageTimer timer(quiet, result.times);
  FindTracks(request, config, timer, result);
  return result;
}

}  // namespace unlidar
