// Where the frames of a live run come from: stdin, packets or folders.
#pragma once

#include <memory>
#include <optional>

#include "app/live.hpp"
#include "app/live_event_reporter.hpp"
#include "app/live_intake.hpp"
#include "app/live_summary.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Reads what has come, and hands it to the intake frame by frame.
class LiveSource {
 public:
  LiveSource() = default;
  virtual ~LiveSource() = default;
  LiveSource(const LiveSource&) = delete;
  LiveSource& operator=(const LiveSource&) = delete;

  // Ready to read when something has come.
  virtual int fd() const = 0;

  // Whether all that came is read, so that it is time to wait.
  virtual bool is_idle() const { return true; }

  // Reads some of what has come; `is_ready`: as fd() is. False at the end of it all. Throws
  // InputError, OutputError.
  virtual bool Read(bool is_ready) = 0;

  // The run ends: reads what came until now, and hands on what is not a whole frame yet.
  virtual void Finish() {}

  // Adds what only the source knows. The inputs of `summary` are the sensors.
  virtual void AddTo(LiveSummary*) const {}
};

// The source that a request names. Frames of folders up to `after_ns` are passed over. All
// references outlive it. Throws InputError.
std::unique_ptr<LiveSource> OpenSource(const LiveRequest& request, const Config& config,
                                       std::optional<TimeNs> after_ns, LiveIntake& intake,
                                       LiveEventReporter& reporter);

}  // namespace unlidar
