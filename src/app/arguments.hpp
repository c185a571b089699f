// The command line.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/frames.hpp"

namespace unlidar {

// Empty texts: not given.
struct Arguments {
  std::vector<FrameSource> sources;
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
  std::string trace;
  bool follow = false;
  bool from_stdin = false;
  std::string livox;
  std::string events;
  int event_returns = 0;
  std::string state;
  std::string metrics;
  int threads = 1;
  bool quiet = false;
  bool verbose = false;

  // Frames come while the program runs; otherwise they are a recording.
  bool is_live() const { return follow || has_no_folders(); }
  // A track above it is left out: never below a half, so that none is for being unknown.
  double max_bird_probability() const { return 1.0 - 0.5 * only_drones; }
  bool has_no_folders() const { return from_stdin || !livox.empty(); }
};

// Fills `arguments`. Returns the text that --help or --version asks for instead. Throws UsageError
// for options that are none, that do not go together, or whose form is wrong.
std::optional<std::string> ParseArguments(int argc, const char* const* argv, Arguments* arguments);

}  // namespace unlidar
