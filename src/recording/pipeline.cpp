#include "recording/pipeline.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "base/format.hpp"
#include "base/maths.hpp"
#include "io/frame_directory.hpp"
#include "scene/pose_check.hpp"
#include "scene/sensor_health.hpp"
#include "scene/sway.hpp"

namespace unlidar {
namespace {

// Measures the times of consecutive stages.
class StageTimer {
 public:
  using Clock = std::chrono::steady_clock;

  StageTimer(const ProgressCallback& progress, std::vector<StageTime>& times)
      : progress_(progress), times_(times) {}

  // Ends the stage that began at the end of the previous one. `interleaved`: its total time, if it
  // is interleaved with the next one.
  void End(const std::string& stage, const std::string& found,
           std::optional<Clock::duration> interleaved = std::nullopt) {
    const Clock::duration taken = interleaved.value_or(Clock::now() - begin_);
    begin_ += taken;
    times_.push_back({stage, std::chrono::duration<double>(taken).count()});
    progress_(times_.back(), found);
  }

 private:
  const ProgressCallback& progress_;
  std::vector<StageTime>& times_;
  Clock::time_point begin_ = Clock::now();
};

ReturnStatistics DescribeReturns(const Recording& recording, const Target& target) {
  const Trajectory& trajectory = target.trajectory;
  ReturnStatistics statistics;
  for (const Measurement& m : target.measurements) {
    statistics.echo_m2_per_s += m.support * (m.position_m - m.viewpoint_m).squaredNorm();
  }
  statistics.echo_m2_per_s /= std::max(SecondsOf(trajectory.duration_ns), 1e-3);
  double sum_m2 = 0.0;
  const Eigen::Vector3d viewpoint_m = target.measurements.front().viewpoint_m;
  for (const std::uint32_t i : target.returns) {
    const Eigen::Vector3d centre_m =
        trajectory.At(recording.times_ns[i] + target.time_bias_ns).position_m;
    const Eigen::Vector3d offset_m = recording.points_m[i].cast<double>() - centre_m;
    const Eigen::Vector3d ray = (centre_m - viewpoint_m).stableNormalized();
    sum_m2 += offset_m.squaredNorm() - Square(offset_m.dot(ray));
  }
  if (!target.returns.empty()) {
    statistics.extent_m =
        std::sqrt(std::max(0.0, sum_m2) / static_cast<double>(target.returns.size()));
  }
  return statistics;
}

FittedTrack TrackOf(const Recording& recording, const Target& target,
                    const TrajectoryConfig& config) {
  FittedTrack track;
  RowSource& rows = track.row_source;
  rows.trajectory = target.trajectory;
  rows.presence =
      ExistenceInterval(recording, target.measurements, config.min_missed_run_probability);
  rows.common_errors = target.common_errors;
  SetViewpoints(target.measurements, &rows.viewpoints);
  rows.covariance_inflations = CovarianceInflationsOf(target.alternative_modes, rows.trajectory);
  rows.max_sigma_m = config.max_sigma_m;
  rows.support = SupportByFrame(recording, target.returns);
  track.score = target.score;
  track.length_m = PathLength(rows.trajectory);
  track.returns = target.returns;
  KindFilter kind;
  kind.Observe(rows.trajectory, track.end_ns());
  track.flight = kind.Describe();
  track.echo = DescribeReturns(recording, target);
  return track;
}

std::string InputSummary(const Recording& recording) {
  return Count(recording.counts.frames, "frame") + ", " + Count(recording.counts.returns, "return");
}

// Feeds the frames of an in-memory recording as if they were read.
FrameFeed FeedOf(const Recording& recording) {
  return [&recording, next = std::size_t{0}](TimeNs until_ns, Recording* part) mutable {
    part->sensors = recording.sensors;
    part->counts = recording.counts;
    part->warnings = recording.warnings;
    for (; next < recording.frames.size() && recording.frames[next].stamp_ns < until_ns; ++next) {
      FrameInfo frame = recording.frames[next];
      const auto first = static_cast<std::uint32_t>(part->points_m.size());
      for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
        part->points_m.push_back(recording.points_m[i]);
        part->times_ns.push_back(recording.times_ns[i]);
      }
      frame.last_return = first + (frame.last_return - frame.first_return);
      frame.first_return = first;
      part->frames.push_back(frame);
    }
    return next < recording.frames.size() ? recording.frames[next].stamp_ns
                                          : std::numeric_limits<TimeNs>::max();
  };
}

// Checks the sensors by their frames, and removes the sway of their stations.
class SensorMonitors {
 public:
  explicit SensorMonitors(bool removes_sway) : removes_sway_(removes_sway) {}

  // Adds the frames of a recording from number `first` on.
  void Add(std::size_t first, Recording* recording) {
    if (removes_sway_) RemoveSway(first, recording);
    health_.resize(recording->sensors.size());
    poses_.resize(recording->sensors.size());
    for (std::size_t i = first; i < recording->frames.size(); ++i) {
      const FrameInfo& frame = recording->frames[i];
      const SensorInfo& sensor = recording->sensors[frame.sensor];
      const PointsView points_m(recording->points_m.data() + frame.first_return,
                                frame.last_return - frame.first_return);
      health_[frame.sensor].AddFrame(sensor, frame.begin_ns, points_m);
      poses_[frame.sensor].AddFrame(sensor, frame.begin_ns, points_m);
    }
  }

  void Finish(PipelineResult* result) {
    result->warnings = result->recording.warnings;
    for (std::uint32_t i = 0; i < health_.size(); ++i) {
      const std::string& name = result->recording.sensors[i].name;
      result->blinded_s.push_back(health_[i].blinded_s());
      result->sway_deg.push_back(sway_.LargestDeg(i));
      if (auto warning = sway_.WarningOf(i, name)) result->warnings.push_back(*warning);
      poses_[i].Finish();
      for (Warning& warning : poses_[i].WarningsOf(name)) {
        result->warnings.push_back(std::move(warning));
      }
    }
  }

 private:
  // All frames are observed before the first is corrected: sway is removed from the first frame of
  // a period on.
  void RemoveSway(std::size_t first_frame, Recording* recording) {
    const auto frame_of = [&](std::size_t i) {
      FrameInfo& info = recording->frames[i];
      const std::size_t first = info.first_return;
      return SwayingFrame{
          &info, recording->points_m.data() + first, info.last_return - first,
          [recording, first](std::size_t k) { return recording->times_ns[first + k]; }};
    };
    std::vector<SwayEstimate> estimates;
    for (std::size_t i = first_frame; i < recording->frames.size(); ++i) {
      estimates.push_back(
          sway_.Observe(recording->sensors[recording->frames[i].sensor], frame_of(i)));
    }
    for (std::size_t i = first_frame; i < recording->frames.size(); ++i) {
      sway_.Correct(sway_.Refine(estimates[i - first_frame], frame_of(i)), frame_of(i));
    }
  }

  bool removes_sway_;
  Sway sway_;
  std::vector<SensorHealth> health_;  // (sensors)
  std::vector<PoseCheck> poses_;      // (sensors)
};

std::vector<Target> ReadAndSearch(const PipelineRequest& request, const Config& config,
                                  const FrameFeed& frames, TimeNs first_stamp_ns,
                                  TimeNs last_stamp_ns, StageTimer& timer, PipelineResult& result) {
  Recording& recording = result.recording;
  std::vector<Target> targets;
  SensorMonitors monitors(config.robust.Uses(Rule::kSway));
  const FrameFeed feed = [&](TimeNs until_ns, Recording* part) {
    const std::size_t known = part->frames.size();
    const TimeNs next_ns = frames(until_ns, part);
    monitors.Add(known, part);
    return next_ns;
  };
  // The paper's scores are those of a whole recording.
  Recording whole;
  if (config.method == Method::kPaper || request.score_clusters) {
    feed(std::numeric_limits<TimeNs>::max(), &whole);
    timer.End("read", InputSummary(whole));
  }
  if (config.method == Method::kPaper) {
    targets = FindTargetsPaper(whole, config.paper, &result.clusters);
    for (Target& target : targets) {
      target.trajectory = FitTrajectoryByCeres(target.measurements, config.trajectory);
    }
    recording = std::move(whole);
  } else {
    if (request.score_clusters) {
      result.clusters = ScoreClusters(whole, config.paper);
      timer.End("clusters", Count(result.clusters.size(), "cluster"));
    }
    const FrameFeed source = request.score_clusters ? FeedOf(whole) : feed;
    StageTimer::Clock::duration reading{};
    const FrameFeed timed = [&](TimeNs until_ns, Recording* part) {
      const auto begin = StageTimer::Clock::now();
      const TimeNs next_ns = source(until_ns, part);
      reading += StageTimer::Clock::now() - begin;
      return next_ns;
    };
    RobustResult robust = FindTargetsInWindows(timed, first_stamp_ns, last_stamp_ns, config.robust,
                                               config.trajectory, request.trace, &recording);
    targets = std::move(robust.targets);
    result.robust_counts = robust.counts;
    if (!request.score_clusters) timer.End("read", InputSummary(recording), reading);
  }
  monitors.Finish(&result);
  std::sort(targets.begin(), targets.end(), [](const Target& a, const Target& b) {
    return std::tie(a.measurements.front().time_ns, a.returns) <
           std::tie(b.measurements.front().time_ns, b.returns);
  });
  timer.End("targets", Count(targets.size(), "target"));
  return targets;
}

void MakeTracks(const PipelineRequest& request, const Config& config,
                const std::vector<Target>& targets, StageTimer& timer, PipelineResult& result) {
  const Recording& recording = result.recording;
  result.output_instants = ResolveOutputTimes(request.output_times, recording);
  int next_id = 0;
  for (const Target& target : targets) {
    FittedTrack track = TrackOf(recording, target, config.trajectory);
    track.row_source.track_id = next_id++;
    if (track.flight.kind.bird_like > request.max_bird_probability) {
      ++result.tracks_left_out;
      continue;
    }
    for (const RowStream next = RowsOf(result, track); next();) ++track.num_rows;
    result.tracks.push_back(std::move(track));
  }
  timer.End("trajectories", Count(result.tracks.size(), "track"));
}

// If the first sensor's frames are numbered, small whole output times are frame numbers.
OutputTimes TimesOf(const PipelineRequest& request, const FrameClock& clock) {
  const auto* const list = std::get_if<std::vector<TimeNs>>(&request.output_times);
  const auto is_number = [](TimeNs time_ns) {
    return 0 <= time_ns && time_ns < TimeNs{kMinUnixS} * kNsPerSecond;
  };
  if (list == nullptr || !request.are_times_whole || !clock.counts() ||
      !std::all_of(list->begin(), list->end(), is_number)) {
    return request.output_times;
  }
  std::vector<TimeNs> numbered;
  for (const TimeNs time_ns : *list) {
    const TimeNs number = time_ns / kNsPerSecond;
    const std::optional<TimeNs> instant_ns = clock.OfNumber(static_cast<double>(number));
    if (instant_ns) numbered.push_back(*instant_ns);
  }
  return numbered;
}

// Warns of output times outside of the recording, which would leave the output empty without any
// visible reason.
void WarnOfTimesOutside(const OutputTimes& times, const FrameReader& reader,
                        std::vector<Warning>* warnings) {
  const auto* const list = std::get_if<std::vector<TimeNs>>(&times);
  const auto is_within = [&](TimeNs time_ns) {
    return reader.first_stamp_ns() - kNsPerSecond <= time_ns &&
           time_ns <= reader.last_stamp_ns() + kNsPerSecond;
  };
  if (list == nullptr || std::any_of(list->begin(), list->end(), is_within)) return;
  warnings->push_back(
      {"output_times_outside", "--at: none of its " + Count(list->size(), "time") +
                                   " is within the recording, expected times of its stamps"});
}

}  // namespace

PipelineResult RunPipeline(const PipelineRequest& request, const Config& config,
                           const ProgressCallback& progress) {
  PipelineResult result;
  StageTimer timer(progress, result.times);
  FrameReader reader(request.sources, config);
  const FrameFeed feed = [&](TimeNs until_ns, Recording* recording) {
    return reader.ReadUntil(until_ns, recording);
  };
  PipelineRequest timed = request;
  timed.output_times = TimesOf(request, reader.first_clock());
  const std::vector<Target> targets = ReadAndSearch(timed, config, feed, reader.first_stamp_ns(),
                                                    reader.last_stamp_ns(), timer, result);
  WarnOfTimesOutside(timed.output_times, reader, &result.warnings);
  MakeTracks(timed, config, targets, timer, result);
  return result;
}

PipelineResult TracksOf(const Recording& recording, const OutputTimes& output_times,
                        const Config& config) {
  PipelineRequest request;
  request.output_times = output_times;
  PipelineResult result;
  const ProgressCallback quiet = [](const StageTime&, const std::string&) {};
  StageTimer timer(quiet, result.times);
  if (recording.frames.empty()) result.recording = recording;
  const std::vector<Target> targets =
      recording.frames.empty()
          ? std::vector<Target>()
          : ReadAndSearch(request, config, FeedOf(recording), recording.frames.front().stamp_ns,
                          recording.frames.back().stamp_ns, timer, result);
  MakeTracks(request, config, targets, timer, result);
  return result;
}

}  // namespace unlidar
