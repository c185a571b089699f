#include "app/track_drones.hpp"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "app/output.hpp"
#include "app/summary.hpp"
#include "app/trace_output.hpp"
#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "base/parallel.hpp"
#include "config/config.hpp"
#include "io/stamp.hpp"
#include "recording/pipeline.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// The output files asked for, each with its option.
std::vector<std::pair<const char*, std::string>> Outputs(const Arguments& arguments) {
  std::vector<std::pair<const char*, std::string>> outputs = {
      {"--out", arguments.out},
      {"--clusters", arguments.clusters},
      {"--points", arguments.points},
      {"--summary", arguments.summary},
      {"--trace", arguments.trace},
      {"--events", arguments.events},
      {"--event-returns-file", arguments.event_returns_file},
      {"--state", arguments.state},
      {"--metrics", arguments.metrics}};
  EraseIf(&outputs, [](const auto& output) { return output.second.empty(); });
  return outputs;
}

// True for a file that the next run would read as a part of the recording.
bool IsFrameInput(const std::string& resolved, const std::vector<FrameSource>& sources) {
  const std::filesystem::path path(resolved);
  if (path.extension() != ".pcd" && path.filename() != "timestamps.csv") return false;
  return std::any_of(sources.begin(), sources.end(), [&](const FrameSource& source) {
    return path.parent_path() == ResolvedPath(source.directory);
  });
}

// Finds what would spoil the outputs before the long work begins, not after it.
void CheckOutputs(const Arguments& arguments) {
  std::map<std::string, std::string> taken;  // resolved path -> option
  if (!arguments.config.empty()) taken[ResolvedPath(arguments.config)] = "--config";
  if (!arguments.at.empty()) taken[ResolvedPath(arguments.at)] = "--at";
  for (const auto& [name, file] : arguments.poses) taken[ResolvedPath(file)] = "--poses";
  for (const auto& [option, path] : Outputs(arguments)) {
    if (path == "-" || IsSpecialFile(path)) continue;  // several outputs may go to /dev/null
    const std::string resolved = ResolvedPath(path);
    const auto [other, is_free] = taken.emplace(resolved, option);
    if (!is_free) {
      throw UsageError(option + (" " + path) + ": the same file as " + other->second +
                       ", expected another");
    }
    if (IsFrameInput(resolved, arguments.sources)) {
      throw UsageError(option + (" " + path) +
                       ": would become an input of the next run, expected a path outside the "
                       "--frames directories");
    }
  }
  if (arguments.is_live()) return;  // those that grow are opened at once
  for (const auto& [option, path] : Outputs(arguments)) CheckWritable(path);
}

// STEM_track<ID>.EXT beside the path.
std::string PathOfTrack(const std::string& path, int track_id) {
  std::filesystem::path result(path);
  result.replace_filename(result.stem().string() + "_track" + std::to_string(track_id) +
                          result.extension().string());
  return result.string();
}

std::vector<OutputFile> TrajectoryFiles(const Arguments& arguments, const PipelineResult& result) {
  const std::vector<FittedTrack>& tracks = result.tracks;
  if (arguments.format == "csv") {
    return {{arguments.out, [&result](const Sink& sink) {
               std::vector<RowStream> rows;
               for (const FittedTrack& track : result.tracks) rows.push_back(RowsOf(result, track));
               WriteTrajectoryCsv(rows, sink);
             }}};
  }
  const auto tum_file = [&result](const std::string& path, const FittedTrack& track) {
    return OutputFile{path, [&result, &track](const Sink& sink) {
                        WriteTrajectoryTum(RowsOf(result, track), sink);
                      }};
  };
  const auto best = std::max_element(tracks.begin(), tracks.end(), By(&FittedTrack::score));
  if (best == tracks.end()) {
    return {{arguments.out, [](const Sink& sink) { WriteTrajectoryTum({}, sink); }}};
  }
  std::vector<OutputFile> files = {tum_file(arguments.out, *best)};
  if (IsSpecialFile(arguments.out)) return files;  // nothing lies beside a pipe
  for (const FittedTrack& track : tracks) {
    if (&track == &*best) continue;
    files.push_back(tum_file(PathOfTrack(arguments.out, track.id()), track));
  }
  return files;
}

void PrintFindings(const std::vector<std::string>& trajectory_paths, const PipelineResult& result) {
  const InputCounts& counts = result.recording.counts;
  for (const Warning& warning : result.warnings) PrintNote("warning: " + warning.text);
  if (counts.bad_frames > 0) {
    PrintNote(Count(counts.bad_frames, "frame") + kUnparsedText);
  }
  if (counts.unplaced_frames > 0) {
    PrintNote(Count(counts.unplaced_frames, "frame") + " left out for want of a pose");
  }
  for (std::size_t i = 0; i < result.blinded_s.size(); ++i) {
    if (result.blinded_s[i] > 0.0) {
      PrintNote(BlindedText(result.recording.sensors[i].name, result.blinded_s[i]));
    }
  }
  for (const FittedTrack& track : result.tracks) {
    const MinimumReport& minimum = track.row_source.trajectory.minimum;
    if (!minimum.converged) PrintNote(NotConvergedText(track.id(), minimum));
  }
  if (result.tracks_left_out > 0) PrintNote(TracksLeftOutText(result.tracks_left_out));
  if (result.tracks.empty()) PrintNote(NothingFoundText(counts));
  std::size_t rows = 0;
  for (const FittedTrack& track : result.tracks) rows += track.num_rows;
  for (std::size_t i = 1; i < trajectory_paths.size(); ++i) {
    PrintNote("a further track is in " + trajectory_paths[i]);
  }
  PrintResult(ResultText(trajectory_paths.front(), result.tracks.size(), rows, counts.frames,
                         result.recording.sensors.size()));
}

void TrackRecorded(const Arguments& arguments, PipelineRequest request, const Config& config) {
  const auto progress = [&](const StageTime& time, const std::string& found) {
    if (arguments.verbose) {
      PrintNote(time.stage + ": " + found + " (" + std::to_string(time.seconds) + " s)");
    }
  };
  std::optional<TraceOutput> trace;
  if (!arguments.trace.empty()) {
    if (config.method != Method::kRobust) {
      throw ConfigError("method: 'paper', expected robust with --trace");
    }
    trace.emplace();
    request.trace = [&](const Recording& recording, const SearchTrace& search) {
      trace->Add(recording, search);
    };
  }
  const PipelineResult result = RunPipeline(request, config, progress);
  std::vector<OutputFile> files = TrajectoryFiles(arguments, result);
  std::vector<std::string> trajectory_paths;
  trajectory_paths.reserve(files.size());
  for (const OutputFile& file : files) trajectory_paths.push_back(file.path);
  if (!arguments.clusters.empty()) {
    files.push_back({arguments.clusters, Content(ClustersCsv(result.clusters))});
  }
  if (!arguments.points.empty()) {
    files.push_back({arguments.points, Content(TargetPointsPcd(result.recording, result.tracks))});
  }
  if (!arguments.summary.empty()) {
    files.push_back({arguments.summary, Content(SummaryJson(request.sources, config, result))});
  }
  if (trace) {
    files.push_back({arguments.trace, [&](const Sink& sink) { trace->Write(sink); }});
  }
  WriteFiles(files);
  if (!arguments.quiet) PrintFindings(trajectory_paths, result);
}

}  // namespace

void TrackDrones(const Arguments& arguments) {
  MaxThreads() = arguments.threads;
  PipelineRequest request;
  request.sources = arguments.sources;
  request.score_clusters = !arguments.clusters.empty();
  request.max_bird_probability = arguments.max_bird_probability();
  if (!arguments.rate.empty()) request.output_times = ParseRate(arguments.rate);
  if (!arguments.at.empty()) {
    request.output_times = ReadStampList(arguments.at, &request.are_times_whole);
  }
  Config config = LoadConfig(arguments.config, arguments.assignments);
  CheckSensorNames(config, arguments.sources);
  CheckOutputs(arguments);
  config.poses = ReadPoseFiles(arguments.poses);
  if (!arguments.is_live()) return TrackRecorded(arguments, request, config);
  const std::string done =
      TrackLive(arguments, request.output_times, config, [&](const std::string& text) {
        if (!arguments.quiet) PrintNote(text);
      });
  if (!arguments.quiet && arguments.events != "-") PrintResult(done);
}

}  // namespace unlidar
