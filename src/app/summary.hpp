// Counts of a run, and what is told of them: --summary as JSON (version, effective config, inputs,
// counts, tracks), and of a live run --state and --metrics.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "app/live_output.hpp"
#include "app/packet_recorder.hpp"
#include "io/followed_folders.hpp"
#include "io/livox_frames.hpp"
#include "recording/pipeline.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Counts by magnitude, so that its size does not grow with the number of frames.
class ProcessingTimes {
 public:
  void Add(double seconds);

  // A time that at least this share of the frames did not exceed: the smallest one, or up to 2 %
  // more of it (1 us more below that). 0 before the first frame.
  double Quantile(double share) const;

  double max_s() const { return max_s_; }
  double sum_s() const { return sum_s_; }
  std::uint64_t frames() const { return frames_; }

 private:
  static constexpr std::size_t kSteps = 1100;  // of 2 % from 1 us: to 40 minutes

  std::array<std::uint64_t, kSteps> counts_{};
  std::uint64_t frames_ = 0;
  double max_s_ = 0.0;
  double sum_s_ = 0.0;
};

// CPU time of this thread so far, independent of the load by other programs.
double ThreadCpuSeconds();

struct LiveInput {
  std::string name;
  std::string directory;  // empty for stdin and --livox
  std::uint64_t frames = 0;
  std::optional<SensorState> state;    // none before its first frame
  double blinded_s = 0.0;              // as of SensorHealth
  double sway_deg = 0.0;               // as of Sway
  std::optional<LivoxCounts> packets;  // of --livox, as is
  std::optional<LivoxSync> sync;
};

// Every frame that came is in one of the counts of frames, every packet in one of packets.
// Its size does not grow with the length of the run.
struct LiveSummary {
  std::vector<LiveInput> inputs;
  InputCounts counts;
  std::uint64_t late_frames = 0;      // later than live.reorder_s
  std::uint64_t astray_frames = 0;    // of stamps that were not borne out
  std::uint64_t overflow_frames = 0;  // more than may wait for live.reorder_s
  std::uint64_t overload_frames = 0;  // left out to keep up
  FollowedCounts followed;
  ProcessingTimes processing_times;   // of the processor, in the engine
  std::uint64_t refused_packets = 0;  // that are none of a Livox sensor
  std::optional<RecordingCounts> recording;
  OutputCounts output;
  std::vector<Warning> warnings;
};

// Present state of a live run, for those who watch it.
struct LiveStatus {
  LiveState state = LiveState::kWarmingUp;
  bool has_ended = false;
  TimeNs written_ns = 0;     // Unix time of this computer
  TimeNs newest_ns = 0;      // stamp; 0 before the first frame
  std::uint64_t one_in = 1;  // frames processed: all, or under overload one in so many
  std::size_t memory_bytes = 0;
  LiveSummary summary;
  std::vector<CurrentTrack> tracks;  // that have begun and not ended
};

// Returns the summary of a recording, with the times of its stages, which no other output has.
std::string SummaryJson(const std::vector<FrameSource>& sources, const Config& config,
                        const PipelineResult& result);

std::string LiveSummaryJson(const LiveSummary& summary, const std::vector<LiveTrack>& tracks,
                            const Config& config);

// JSON of one object: docs/schemas/state.schema.json.
std::string StateJson(const LiveStatus& status);

// Prometheus' text format, version 0.0.4.
std::string MetricsText(const LiveStatus& status);

}  // namespace unlidar
