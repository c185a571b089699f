// Present state of a live run for those who watch it: --state and --metrics.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "app/arguments.hpp"
#include "app/live_output.hpp"
#include "app/output_files.hpp"
#include "app/summary.hpp"
#include "unlidar/engine.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

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

// JSON of one object: docs/schemas/state.schema.json.
std::string StateJson(const LiveStatus& status);

// Prometheus' text format, version 0.0.4.
std::string MetricsText(const LiveStatus& status);

// The files, replaced once a second by the clock of this computer.
class LiveStatusFiles {
 public:
  // `arguments`, `note`: must outlive it.
  LiveStatusFiles(const Arguments& arguments, const NoteCallback& note)
      : arguments_(arguments), note_(note) {}

  // Replaces the files if they are due, or at the end. A disk that is full must not end the run:
  // the first failure of several in a row is a note.
  void WriteIfDue(bool is_end, const std::function<LiveStatus()>& status);

 private:
  using Clock = std::chrono::steady_clock;

  const Arguments& arguments_;
  const NoteCallback& note_;
  std::optional<Clock::time_point> written_;
  bool has_failed_ = false;
};

}  // namespace unlidar
