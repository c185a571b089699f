#include "app/arguments.hpp"

#include <CLI/CLI.hpp>
#include <cstddef>
#include <set>
#include <sstream>
#include <utility>

#include "app/output_files.hpp"
#include "app/returns_view.hpp"
#include "app/version.hpp"
#include "base/format.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr char kDescription[] =
    "Finds flying drones in the frames of LiDARs, without training, and writes their\n"
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
constexpr std::uint64_t kMaxCapturesBytes = 1'000'000'000'000'000;

CLI::Option* AddFile(CLI::App& app, const char* option, std::string& path,
                     const char* description) {
  return app.add_option(option, path, description)
      ->check([](const std::string& text) { return text.empty() ? "empty, expected a name" : ""; })
      ->type_name("FILE");
}

// CLI11 would take -1 for 2^64 - 1, as it does any longer number.
std::string SizeProblem(const std::string& text) {
  const std::size_t num_digits = std::min(text.find_first_not_of("0123456789"), text.size());
  if (num_digits > 0 && num_digits < 20) return "";
  return Quoted(text) + ", expected bytes or a size with a unit, as 500MB";
}

void AddRecordingOptions(CLI::App& app, Arguments& arguments) {
  CLI::Option* record_packets =
      AddFile(app, "--record-packets", arguments.record_packets,
              "With --livox: directory for captures of all packets that come\n"
              "(packets_*.pcap), which unlidar convert and play read; the\n"
              "oldest ones are removed")
          ->type_name("DIR");
  const auto add_size = [&](const char* option, auto& bytes, const char* description) {
    return app.add_option(option, bytes, description)
        ->transform(CLI::AsSizeValue(true).description(""))
        ->transform(CLI::Validator(SizeProblem, ""))  // goes first
        ->needs(record_packets)
        ->type_name("SIZE");
  };
  add_size("--record-packets-bytes", arguments.record_packets_bytes,
           "Most of all these captures, as in 500MB")
      ->capture_default_str();
  add_size("--record-packets-file-bytes", arguments.record_packets_file_bytes,
           "Most of one of them (default: a fortieth of that)");
}

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
  CLI::Option* events = app.add_option("--events", arguments.events,
                                       "With these three: JSON lines to write, `-` for stdout:\n"
                                       "tracks, rows, sensors that fall silent, overload")
                            ->type_name("FILE|-");
  CLI::Option* returns =
      app.add_option("--event-returns", arguments.event_returns,
                     "Events also with up to N returns of each LiDAR, five times a\n"
                     "second, for a page that shows them; N to 2000")
          ->check(CLI::Range(1, kMaxViewReturns).description(""))
          ->type_name("N")
          ->needs(events);
  AddFile(app, "--event-returns-file", arguments.event_returns_file,
          "These events into a file of their own, of the newest megabyte")
      ->needs(returns);
  AddFile(app, "--state", arguments.state,
          "The same: JSON to replace once a second: what it is doing now,\n"
          "tracks, sensors, load");
  AddFile(app, "--metrics", arguments.metrics, "The same as metrics, for Prometheus");
  AddRecordingOptions(app, arguments);
}

void AddOptions(CLI::App& app, Arguments& arguments, std::vector<std::string>& frames,
                std::vector<std::string>& poses) {
  app.footer(kFooter);
  app.get_formatter()->column_width(28);
  app.set_help_flag("-h,--help", "Print this help and exit");
  app.set_version_flag("--version", std::string("unlidar_track ") + kVersion,
                       "Print the version and exit");
  app.add_option("--frames", frames,
                 "Directory of *.pcd frames, once per LiDAR. NAME ties it to\n"
                 "sensors.NAME of the config; a path with '=' in its first part\n"
                 "is written ./PATH")
      ->type_name("[NAME=]DIR")
      ->allow_extra_args(false);
  app.add_option("--poses", poses,
                 "Poses of a LiDAR that moves, or of what carries it with\n"
                 "sensors.NAME as its place there: lines `stamp x y z qx qy qz qw`\n"
                 "(TUM); without NAME of all LiDARs. Rows are in the world of the\n"
                 "poses")
      ->type_name("[NAME=]FILE")
      ->allow_extra_args(false);
  AddFile(app, "--out", arguments.out, "Trajectory to write")->required();
  AddFile(app, "--config", arguments.config, "YAML of config keys, see configs/default.yaml");
  app.add_option("--set", arguments.assignments,
                 "Sets one config key after --config; VALUE is YAML; repeatable")
      ->type_name("SECTION.KEY=VALUE")
      ->allow_extra_args(false);
  CLI::Option* at = AddFile(app, "--at", arguments.at,
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
  AddFile(app, "--clusters", arguments.clusters,
          "CSV to write: every number of the paper's score, per cluster");
  AddFile(app, "--points", arguments.points, "PCD to write: the returns taken as target");
  AddFile(app, "--summary", arguments.summary,
          "JSON to write: version, effective config, counts and times per\n"
          "stage, tracks");
  AddFile(app, "--trace", arguments.trace,
          "JSON lines to write: what was detected in each frame, and which\n"
          "rule refused each path of detections (docs/explain.md)");
  app.add_option("--only-drones", arguments.only_drones,
                 "Leaves out what is surely a bird, judged by how it flies: tracks\n"
                 "that are one with more than 1 - P / 2. While frames come: their\n"
                 "rows wait as long as that holds")
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

// Throws if the option is given.
void Refuse(const char* option, const std::string& value, const std::string& problem) {
  if (!value.empty()) throw UsageError(option + (" " + value) + ": " + problem);
}

void CheckRecording(const Arguments& arguments) {
  if (arguments.record_packets.empty()) return;
  if (arguments.livox.empty()) {
    Refuse("--record-packets", arguments.record_packets, "expected with --livox only");
  }
  const auto check = [](const char* option, std::uint64_t bytes, std::uint64_t least,
                        std::uint64_t most) {
    if (bytes >= least && bytes <= most) return;
    Refuse(option, std::to_string(bytes),
           "expected " + std::to_string(least) + " to " + std::to_string(most) + " bytes");
  };
  check("--record-packets-bytes", arguments.record_packets_bytes, 2 * kMinCaptureBytes,
        kMaxCapturesBytes);
  check("--record-packets-file-bytes", arguments.capture_file_bytes(), kMinCaptureBytes,
        arguments.record_packets_bytes / 2);
}

// Checks the combination of options: a recording or a live source.
void CheckMode(const Arguments& arguments, const std::vector<std::string>& frames) {
  if (!(arguments.only_drones >= 0.0 && arguments.only_drones <= 1.0)) {  // NaN, too
    Refuse("--only-drones", ShortestText(arguments.only_drones),
           "expected a probability from 0 to 1");
  }
  if (frames.empty() && !arguments.has_no_folders()) {
    throw UsageError("--frames is required (--help lists all options)");
  }
  CheckRecording(arguments);
  if (!arguments.is_live()) {
    constexpr const char* kExpectedMode = "expected with --follow, --stdin or --livox only";
    Refuse("--events", arguments.events, kExpectedMode);
    Refuse("--state", arguments.state, kExpectedMode);
    Refuse("--metrics", arguments.metrics, kExpectedMode);
    return;
  }
  const std::string mode = arguments.follow       ? "--follow"
                           : arguments.from_stdin ? "--stdin"
                                                  : "--livox";
  if (arguments.has_no_folders() && !frames.empty()) {
    throw UsageError("--frames " + frames.front() + ": expected none with " + mode +
                     ", whose frames name their sensor");
  }
  const std::string not_with = "not with " + mode + ", ";
  Refuse("--at", arguments.at, not_with + "expected --rate or the stamps of the first LiDAR");
  Refuse("--clusters", arguments.clusters, not_with + "which never has the whole recording");
  Refuse("--points", arguments.points, not_with + "which never has the whole recording");
  for (const auto& [option, value] : {std::pair{"--trace", &arguments.trace},
                                      {"--state", &arguments.state},
                                      {"--metrics", &arguments.metrics}}) {
    if (*value == "-") Refuse(option, *value, not_with + "expected a file");
  }
  if (arguments.format != "csv") {
    Refuse("--format", arguments.format,
           not_with + "expected csv, which holds any number of tracks");
  }
}

// Splits [NAME=]PATH; no name is empty. `expected`: a file or a directory, for messages.
std::pair<std::string, std::string> SplitNamedPath(const std::string& option,
                                                   const std::string& text, const char* expected) {
  const std::size_t equals = text.find('=');
  const bool is_named = equals != std::string::npos && text.find('/') > equals;
  const std::string name = is_named ? text.substr(0, equals) : "";
  const std::string path = is_named ? text.substr(equals + 1) : text;
  const std::string problem = option + " " + text + ": ";
  if (is_named && !IsSensorName(name)) {
    throw UsageError(problem + Quoted(name) + ", " + kExpectedSensorName + " before '='");
  }
  if (path.empty()) {
    throw UsageError(problem + "expected a " + expected + (name.empty() ? "" : " after '='"));
  }
  return {name, path};
}

std::vector<FrameSource> ParseSources(const std::vector<std::string>& texts) {
  std::vector<FrameSource> sources;
  std::set<std::string> directories;
  for (const std::string& text : texts) {
    const auto [name, directory] = SplitNamedPath("--frames", text, "directory");
    sources.push_back({name, directory});
    if (!directories.insert(ResolvedPath(directory)).second) {
      throw UsageError("--frames " + text + ": given twice, expected one directory per LiDAR");
    }
  }
  CheckNames(sources);
  return sources;
}

PoseFiles ParsePoseFiles(const std::vector<std::string>& texts) {
  PoseFiles files;
  for (const std::string& text : texts) {
    const auto [name, path] = SplitNamedPath("--poses", text, "file");
    if (!files.emplace(name, path).second) {
      throw UsageError("--poses " + text + ": given twice" +
                       (name.empty() ? " without a name" : " for " + name) +
                       ", expected one file per LiDAR");
    }
  }
  return files;
}

// Poses of a LiDAR that does not take part would silently be ignored. Live ones may come later.
void CheckPoseNames(const Arguments& arguments) {
  if (arguments.has_no_folders()) return;
  for (const auto& [name, file] : arguments.poses) {
    const auto is_named = [&, &name = name](const FrameSource& source) {
      return SourceName(source) == name;
    };
    const std::vector<FrameSource>& sources = arguments.sources;
    if (name.empty() || std::any_of(sources.begin(), sources.end(), is_named)) continue;
    throw UsageError("--poses " + name + "=" + file + ": no --frames has that name");
  }
}

}  // namespace

std::optional<std::string> ParseArguments(int argc, const char* const* argv, Arguments* arguments) {
  std::vector<std::string> frames;
  std::vector<std::string> poses;
  CLI::App app(kDescription, "unlidar_track");
  AddOptions(app, *arguments, frames, poses);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& request) {  // --help, --version
    std::ostringstream text;
    app.exit(request, text, text);
    return text.str();
  } catch (const CLI::ParseError& error) {
    throw UsageError(Shortened(error.what(), kMaxUsageErrorBytes) + " (--help lists all options)");
  }
  CheckMode(*arguments, frames);
  arguments->sources = ParseSources(frames);
  arguments->poses = ParsePoseFiles(poses);
  CheckPoseNames(*arguments);
  return std::nullopt;
}

}  // namespace unlidar
