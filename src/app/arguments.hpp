// The command line.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/frames.hpp"
#include "io/pose_file.hpp"

namespace unlidar {

// A third of a second of a Mid-360.
inline constexpr std::uint64_t kMinCaptureBytes = 1'000'000;

// Empty texts: not given.
struct Arguments {
  std::vector<FrameSource> sources;
  PoseFiles poses;
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
  std::string event_returns_file;
  std::string state;
  std::string metrics;
  std::string record_packets;
  std::uint64_t record_packets_bytes = 4'000'000'000;
  std::optional<std::uint64_t> record_packets_file_bytes;
  int threads = 1;
  bool quiet = false;
  bool verbose = false;

  // Frames come while the program runs; otherwise they are a recording.
  bool is_live() const { return follow || has_no_folders(); }
  // A track above it is left out: never below a half, so that none is for being unknown.
  double max_bird_probability() const { return 1.0 - 0.5 * only_drones; }
  // Size of one capture of packets: by default a fortieth of all, but no less than a megabyte.
  std::uint64_t capture_file_bytes() const {
    return record_packets_file_bytes.value_or(
        std::max(kMinCaptureBytes, record_packets_bytes / 40));
  }
  bool has_no_folders() const { return from_stdin || !livox.empty(); }
};

// Fills `arguments`. Returns the text that --help or --version asks for instead. Throws UsageError
// for options that are none, that do not go together, or whose form is wrong.
std::optional<std::string> ParseArguments(int argc, const char* const* argv, Arguments* arguments);

}  // namespace unlidar
