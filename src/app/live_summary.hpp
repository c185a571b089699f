// The --summary of a live run.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "app/config.hpp"
#include "app/frame_times.hpp"
#include "app/live_output.hpp"
#include "base/recording.hpp"
#include "io/livox_frames.hpp"

namespace unlidar {

struct LiveInput {
  std::string name;
  std::string directory;  // empty for stdin and --livox
  std::uint64_t frames = 0;
  double blinded_s = 0.0;              // as of SensorSight
  std::optional<LivoxCounts> packets;  // of --livox
};

// Every frame that came is in one of the counts of frames, every packet in one of packets.
struct LiveSummary {
  std::vector<LiveInput> inputs;
  InputCounts counts;
  std::uint64_t late_frames = 0;         // later than live.reorder_s
  std::uint64_t overload_frames = 0;     // left out to keep up
  std::uint64_t vanished_frames = 0;     // removed before they could be read
  std::uint64_t passed_over_frames = 0;  // repeated
  FrameTimes frame_times;                // of the processor, in the engine
  std::uint64_t refused_packets = 0;     // that are none of a Livox sensor
  std::vector<LiveTrack> tracks;
  std::uint64_t tracks_left_out = 0;  // as of --only-drones
};

std::string LiveSummaryJson(const LiveSummary& summary, const Config& config);

}  // namespace unlidar
