// The command line: arguments in, files out, every error one line and an exit code.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <map>
#include <new>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "app/config.hpp"
#include "app/live.hpp"
#include "app/output.hpp"
#include "app/output_files.hpp"
#include "app/temporary_path.hpp"
#include "app/version.hpp"
#include "base/format.hpp"
#include "base/parallel.hpp"
#include "recording/pipeline.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

struct Arguments {
  std::vector<std::string> frames;
  std::string out;
  std::string config;
  std::vector<std::string> assignments;
  std::string at;
  std::string rate;
  double only_drones = 0.0;
  std::string format = "csv";
  std::string clusters;
  std::string points;
  std::string summary;
  bool follow = false;
  bool from_stdin = false;
  std::string livox;
  std::string events;
  int threads = 1;
  bool quiet = false;
  bool verbose = false;
};

constexpr char kDescription[] =
    "Finds flying drones in the frames of static LiDARs, without training, and writes their\n"
    "3D trajectories.";

constexpr char kFooter[] =
    "\nExamples:\n"
    "  unlidar_track --frames frames/ --out traj.csv\n"
    "  unlidar_track --frames mid360=frames/mid360 --frames avia=frames/avia --out traj.csv \\\n"
    "                --set 'sensors.avia.translation_m=[0.1, 0, 0.05]' --rate 10\n"
    "  unlidar_track --follow --frames frames/ --out traj.csv --events -\n"
    "  unlidar_track --livox 192.168.1.5:56301 --out traj.csv\n"
    "\nExit codes: 0 done (a drone or none), 1 internal error, 2 usage, 3 config, 4 input data,\n"
    "5 output cannot be written. Every error is one line on stderr.";

constexpr int kMaxThreads = 1024;
constexpr std::size_t kMaxUsageErrorBytes = 300;

void AddLiveOptions(CLI::App& app, Arguments& arguments) {
  CLI::Option* follow = app.add_flag("--follow", arguments.follow,
                                     "Track while frames are written to the --frames directories;\n"
                                     "--out grows row by row. SIGTERM ends it, SIGHUP opens the\n"
                                     "outputs again");
  CLI::Option* from_stdin = app.add_flag("--stdin", arguments.from_stdin,
                                         "The same for frames that come by stdin, each a line\n"
                                         "`frame NAME STAMP LENGTH` and LENGTH bytes of PCD")
                                ->excludes(follow);
  app.add_option("--livox", arguments.livox,
                 "The same for the packets of Livox LiDARs (Mid-360, HAP, Avia)\n"
                 "that come by UDP to this address of this computer; each is a\n"
                 "sensor that has its address as its name, like 192-168-1-12")
      ->type_name("HOST:PORT")
      ->excludes(follow)
      ->excludes(from_stdin);
  app.add_option("--events", arguments.events,
                 "With these three: JSON lines to write, `-` for stdout:\n"
                 "tracks, rows, sensors that fall silent, overload")
      ->type_name("FILE|-");
}

bool HasNoFolders(const Arguments& arguments) {
  return arguments.from_stdin || !arguments.livox.empty();
}

bool IsLive(const Arguments& arguments) { return arguments.follow || HasNoFolders(arguments); }

// What goes together: a recording or a live source.
void CheckMode(const Arguments& arguments) {
  if (!(arguments.only_drones >= 0.0 && arguments.only_drones <= 1.0)) {  // NaN, too
    throw UsageError("--only-drones " + ShortestText(arguments.only_drones) +
                     ": expected a probability from 0 to 1");
  }
  if (arguments.frames.empty() && !HasNoFolders(arguments)) {
    throw UsageError("--frames is required (--help lists all options)");
  }
  if (!IsLive(arguments)) {
    if (arguments.events.empty()) return;
    throw UsageError("--events " + arguments.events +
                     ": expected with --follow, --stdin or --livox only");
  }
  const std::string mode = arguments.follow       ? "--follow"
                           : arguments.from_stdin ? "--stdin"
                                                  : "--livox";
  if (HasNoFolders(arguments) && !arguments.frames.empty()) {
    throw UsageError("--frames " + arguments.frames.front() + ": expected none with " + mode +
                     ", whose frames name their sensor");
  }
  const auto refuse = [&](const char* option, const std::string& value, const char* reason) {
    if (!value.empty())
      throw UsageError(option + (" " + value) + ": not with " + mode + ", " + reason);
  };
  refuse("--at", arguments.at, "expected --rate or the stamps of the first LiDAR");
  refuse("--clusters", arguments.clusters, "which never has the whole recording");
  refuse("--points", arguments.points, "which never has the whole recording");
  if (arguments.format != "csv") {
    refuse("--format", arguments.format, "expected csv, which holds any number of tracks");
  }
}

void AddOptions(CLI::App& app, Arguments& arguments) {
  app.footer(kFooter);
  app.get_formatter()->column_width(28);
  app.set_help_flag("-h,--help", "Print this help and exit");
  app.set_version_flag("--version", std::string("unlidar_track ") + kVersion,
                       "Print the version and exit");
  const auto add_file = [&app](const char* option, std::string& path, const char* description) {
    return app.add_option(option, path, description)
        ->check([](const std::string& text) {
          return text.empty() ? "empty, expected a file name" : "";
        })
        ->type_name("FILE");
  };
  app.add_option("--frames", arguments.frames,
                 "Directory of *.pcd frames, once per LiDAR. NAME ties it to\n"
                 "sensors.NAME of the config; a path with '=' in its first part\n"
                 "is written ./PATH")
      ->type_name("[NAME=]DIR")
      ->allow_extra_args(false);
  add_file("--out", arguments.out, "Trajectory to write")->required();
  add_file("--config", arguments.config, "YAML of config keys, see configs/default.yaml");
  app.add_option("--set", arguments.assignments,
                 "Sets one config key after --config; VALUE is YAML; repeatable")
      ->type_name("SECTION.KEY=VALUE")
      ->allow_extra_args(false);
  CLI::Option* at = add_file("--at", arguments.at,
                             "Output times: one stamp a line, or a CSV with a column\n"
                             "`timestamp`; sorted, and each used once");
  app.add_option("--rate", arguments.rate,
                 "Output times: so many a second. Without --at and --rate: the\n"
                 "stamps of the first --frames")
      ->type_name("HZ")
      ->excludes(at);
  app.add_option("--format", arguments.format,
                 "csv: all tracks with velocity, sigma and support.\n"
                 "tum: `timestamp tx ty tz qx qy qz qw`, the attitude always the\n"
                 "identity; the track with the highest score goes to --out, each\n"
                 "other one beside it to STEM_track<ID>.EXT")
      ->check(CLI::IsMember({"csv", "tum"}).description(""))
      ->type_name("csv|tum")
      ->capture_default_str();
  add_file("--clusters", arguments.clusters,
           "CSV to write: every number of the paper's score, per cluster");
  add_file("--points", arguments.points, "PCD to write: the returns taken as target");
  add_file("--summary", arguments.summary,
           "JSON to write: version, effective config, counts and times per\n"
           "stage, tracks");
  app.add_option("--only-drones", arguments.only_drones,
                 "Leaves out tracks that are a drone with a lower probability than P,\n"
                 "judged by how they fly. While frames come: until it is reached")
      ->check([](const std::string& text) {
        return text.empty() ? "empty, expected a probability from 0 to 1" : "";
      })
      ->type_name("P")
      ->capture_default_str();
  AddLiveOptions(app, arguments);
  app.add_option("--threads", arguments.threads,
                 "Most threads to use, to read and search a recording; never\n"
                 "changes a result")
      ->check(CLI::Range(1, kMaxThreads).description(""))
      ->type_name("N")
      ->capture_default_str();
  CLI::Option* quiet = app.add_flag("--quiet", arguments.quiet, "Print nothing but errors");
  app.add_flag("--verbose", arguments.verbose, "Print each stage and its time on stderr")
      ->excludes(quiet);
}

// Two paths of the longest that there are, and what is said of them.
constexpr std::size_t kMaxMessageBytes = 10'000;

void PrintNote(const std::string& text) {
  WriteToStderr("unlidar_track: " + Shortened(text, kMaxMessageBytes) + "\n");
}

int Fail(ExitCode code, const std::string& text) {
  PrintNote("error: " + text);
  return static_cast<int>(code);
}

FrameSource ParseSource(const std::string& text) {
  const std::size_t equals = text.find('=');
  FrameSource source;
  if (equals != std::string::npos && text.find('/') > equals) {
    source.name = text.substr(0, equals);
    source.directory = text.substr(equals + 1);
    if (!IsSensorName(source.name)) {
      throw UsageError("--frames " + text + ": " + Quoted(source.name) +
                       ", expected a name of letters, digits, '_' and '-' before '='");
    }
  } else {
    source.directory = text;
  }
  if (source.directory.empty()) {
    throw UsageError("--frames " + text + ": expected a directory" +
                     (source.name.empty() ? "" : " after '='"));
  }
  return source;
}

std::vector<FrameSource> ParseSources(const std::vector<std::string>& texts) {
  std::vector<FrameSource> sources;
  std::set<std::string> names;
  std::set<std::string> directories;
  for (const std::string& text : texts) {
    sources.push_back(ParseSource(text));
    const FrameSource& source = sources.back();
    if (!source.name.empty() && !names.insert(source.name).second) {
      throw UsageError("--frames " + text + ": the name is taken, expected one per LiDAR");
    }
    if (!directories.insert(ResolvedPath(source.directory)).second) {
      throw UsageError("--frames " + text + ": given twice, expected one directory per LiDAR");
    }
  }
  return sources;
}

struct NamedPath {
  const char* option;
  std::string path;
};

// The output files asked for.
std::vector<NamedPath> Outputs(const Arguments& arguments) {
  std::vector<NamedPath> outputs = {{"--out", arguments.out}};
  for (const NamedPath& optional :
       {NamedPath{"--clusters", arguments.clusters}, NamedPath{"--points", arguments.points},
        NamedPath{"--summary", arguments.summary}, NamedPath{"--events", arguments.events}}) {
    if (!optional.path.empty()) outputs.push_back(optional);
  }
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
void CheckOutputs(const Arguments& arguments, const std::vector<FrameSource>& sources) {
  std::map<std::string, std::string> taken;  // resolved path -> option
  if (!arguments.config.empty()) taken[ResolvedPath(arguments.config)] = "--config";
  if (!arguments.at.empty()) taken[ResolvedPath(arguments.at)] = "--at";
  for (const auto& [option, path] : Outputs(arguments)) {
    if (path == "-" || IsSpecialFile(path)) continue;  // several outputs may go to /dev/null
    const std::string resolved = ResolvedPath(path);
    const auto [other, is_free] = taken.emplace(resolved, option);
    if (!is_free) {
      throw UsageError(option + (" " + path) + ": the same file as " + other->second +
                       ", expected another");
    }
    if (IsFrameInput(resolved, sources)) {
      throw UsageError(option + (" " + path) +
                       ": would become an input of the next run, expected a path outside the "
                       "--frames directories");
    }
  }
  if (IsLive(arguments)) return;  // those that grow are opened at once
  for (const NamedPath& output : Outputs(arguments)) CheckWritable(output.path);
}

PipelineRequest ToRequest(const Arguments& arguments, const std::vector<FrameSource>& sources) {
  PipelineRequest request;
  request.sources = sources;
  request.score_clusters = !arguments.clusters.empty();
  request.least_drone = arguments.only_drones;
  if (!arguments.rate.empty()) request.output_times = ParseRate(arguments.rate);
  if (!arguments.at.empty()) request.output_times = ReadStampList(arguments.at);
  return request;
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
  const auto best = std::max_element(
      tracks.begin(), tracks.end(),
      [](const FittedTrack& a, const FittedTrack& b) { return a.score < b.score; });
  if (best == tracks.end()) {
    return {{arguments.out, [](const Sink& sink) { WriteTrajectoryTum({}, sink); }}};
  }
  std::vector<OutputFile> files = {tum_file(arguments.out, *best)};
  if (IsSpecialFile(arguments.out)) return files;  // nothing lies beside a pipe
  for (const FittedTrack& track : tracks) {
    if (&track == &*best) continue;
    files.push_back(tum_file(PathOfTrack(arguments.out, track.id), track));
  }
  return files;
}

void AppendOtherFiles(const Arguments& arguments, const PipelineRequest& request,
                      const Config& config, const PipelineResult& result,
                      std::vector<OutputFile>& files) {
  if (!arguments.clusters.empty()) {
    files.push_back({arguments.clusters, Content(ClustersCsv(result.clusters))});
  }
  if (!arguments.points.empty()) {
    files.push_back({arguments.points, Content(TargetPointsPcd(result.recording, result.tracks))});
  }
  if (!arguments.summary.empty()) {
    files.push_back({arguments.summary, Content(SummaryJson(request.sources, config, result))});
  }
}

void PrintResult(const std::vector<std::string>& trajectory_paths, const PipelineResult& result) {
  const InputCounts& counts = result.recording.counts;
  if (counts.bad_frames > 0) {
    PrintNote(Count(counts.bad_frames, "frame") +
              " could not be parsed and skipped (input.skip_bad_frames)");
  }
  if (result.tracks_left_out > 0) PrintNote(TracksLeftOutText(result.tracks_left_out));
  if (result.tracks.empty()) {
    PrintNote("no drone found in " + Count(counts.frames, "frame") + " with " +
              Count(counts.returns, "return"));
  }
  std::size_t rows = 0;
  for (const FittedTrack& track : result.tracks) rows += track.num_rows;
  for (std::size_t i = 1; i < trajectory_paths.size(); ++i) {
    PrintNote("a further track is in " + trajectory_paths[i]);
  }
  WriteToStdout(Shortened(trajectory_paths.front(), kMaxMessageBytes) + ": " +
                Count(result.tracks.size(), "track") + ", " + Count(rows, "row") + ", from " +
                Count(counts.frames, "frame") + " of " +
                Count(result.recording.sensors.size(), "LiDAR") + "\n");
}

void TrackWhileFramesCome(const Arguments& arguments, const std::vector<FrameSource>& sources,
                          const Config& config) {
  LiveRequest request;
  request.sources = sources;
  if (!arguments.livox.empty()) request.livox = ParseLivoxEndpoint(arguments.livox);
  if (!arguments.rate.empty()) request.output_times = ParseRate(arguments.rate);
  request.out = arguments.out;
  request.events = arguments.events;
  request.summary = arguments.summary;
  request.least_drone = arguments.only_drones;
  const std::string done = TrackLive(request, config, [&](const std::string& text) {
    if (!arguments.quiet) PrintNote(text);
  });
  if (arguments.quiet || arguments.events == "-") return;
  WriteToStdout(Shortened(done, kMaxMessageBytes) + "\n");
}

void TrackDrones(const Arguments& arguments) {
  CheckMode(arguments);
  MaxThreads() = arguments.threads;
  const std::vector<FrameSource> sources = ParseSources(arguments.frames);
  const PipelineRequest request = ToRequest(arguments, sources);
  const Config config = LoadConfig(arguments.config, arguments.assignments);
  CheckSensorNames(config, sources);
  CheckOutputs(arguments, sources);
  if (IsLive(arguments)) return TrackWhileFramesCome(arguments, sources, config);

  const auto progress = [&](const StageTime& time, const std::string& found) {
    if (arguments.verbose) {
      PrintNote(time.stage + ": " + found + " (" + std::to_string(time.seconds) + " s)");
    }
  };
  const PipelineResult result = RunPipeline(request, config, progress);
  std::vector<OutputFile> files = TrajectoryFiles(arguments, result);
  std::vector<std::string> trajectory_paths;
  trajectory_paths.reserve(files.size());
  for (const OutputFile& file : files) trajectory_paths.push_back(file.path);
  AppendOtherFiles(arguments, request, config, result, files);
  WriteFiles(files);
  if (!arguments.quiet) PrintResult(trajectory_paths, result);
}

// Where an exception cannot be passed on: destructors of some libraries allocate.
[[noreturn]] void Terminate() {
  TemporaryPath::RemoveAll();
  const char* text = "unlidar_track: error: internal: an exception without a handler\n";
  try {
    if (const std::exception_ptr error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::bad_alloc&) {
    text = "unlidar_track: error: out of memory\n";
  } catch (...) {  // NOLINT(bugprone-empty-catch): the text says it
  }
  WriteToStderr(text);
  std::_Exit(static_cast<int>(ExitCode::kInternal));
}

}  // namespace

int Run(int argc, char** argv) {
  try {
    Arguments arguments;
    CLI::App app(kDescription, "unlidar_track");
    AddOptions(app, arguments);
    try {
      app.parse(argc, argv);
    } catch (const CLI::Success& request) {  // --help, --version
      std::ostringstream text;
      app.exit(request, text, text);
      WriteToStdout(text.str());
      return static_cast<int>(ExitCode::kDone);
    } catch (const CLI::ParseError& error) {
      throw UsageError(Shortened(error.what(), kMaxUsageErrorBytes) +
                       " (--help lists all options)");
    }
    TrackDrones(arguments);
    return static_cast<int>(ExitCode::kDone);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const Error& error) {
    return Fail(error.code(), error.what());
  } catch (const std::exception& error) {
    return Fail(ExitCode::kInternal, std::string("internal: ") + error.what());
  }
}

int Main(int argc, char** argv) {
  // A reader that has gone and a limit of file sizes are errors of writing like others.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  std::set_terminate(Terminate);
  try {
    return Run(argc, argv);
  } catch (const std::bad_alloc&) {
    WriteToStderr("unlidar_track: error: out of memory\n");  // which takes none
    return static_cast<int>(ExitCode::kInternal);
  }
}

}  // namespace unlidar

int main(int argc, char** argv) { return unlidar::Main(argc, argv); }
