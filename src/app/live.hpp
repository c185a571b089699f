// Tracking while frames come: --follow, --stdin and --livox.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "io/frames.hpp"
#include "io/livox_receiver.hpp"
#include "trajectory/output_times.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

struct LiveRequest {
  std::vector<FrameSource> sources;    // folders to follow
  std::optional<LivoxEndpoint> livox;  // where packets come; without it and folders, stdin
  OutputTimes output_times;
  std::string out;
  std::string events;                  // empty for none, `-` for stdout
  std::string summary;                 // empty for none
  double min_drone_probability = 0.0;  // rows of a track wait until it is as likely a drone as that
};

// Runs until stdin ends or SIGTERM or SIGINT comes, then writes what is pending, also where it ends
// with an InputError. `note` gets lines for the user. Returns what was done, in a line.
// Throws InputError, ConfigError, OutputError.
std::string TrackLive(const LiveRequest& request, const Config& config,
                      const std::function<void(const std::string&)>& note);

}  // namespace unlidar
