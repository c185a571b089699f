// Sources of the frames of a live run: stdin, packets or folders.
#pragma once

#include <memory>
#include <optional>

#include "app/arguments.hpp"
#include "app/live_intake.hpp"
#include "app/packet_recorder.hpp"
#include "app/summary.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Reads available input and passes it to the intake frame by frame.
class LiveSource {
 public:
  LiveSource() = default;
  LiveSource(const LiveSource&) = delete;
  LiveSource& operator=(const LiveSource&) = delete;
  virtual ~LiveSource() = default;

  // Descriptor that is readable when input is available.
  virtual int fd() const = 0;

  // True if all available input is read.
  virtual bool is_idle() const { return true; }

  // Reads some input; `is_ready`: fd() is. Returns false at its end. Throws InputError,
  // OutputError.
  virtual bool Read(bool is_ready) = 0;

  // Called at the end of the run: reads the remaining input and passes on incomplete frames.
  virtual void Finish() {}

  // Adds the data of the source. The inputs of `summary` are the sensors.
  virtual void AddTo(LiveSummary*) const {}
};

// Opens the source that the arguments name. Frames of folders up to `after_ns` are skipped. All
// references must outlive it, and so must `captures`, which is null where packets are not recorded.
// Throws InputError.
std::unique_ptr<LiveSource> OpenSource(const Arguments& arguments, const Config& config,
                                       std::optional<TimeNs> after_ns, LiveIntake& intake,
                                       LiveEventReporter& reporter, CaptureFiles* captures);

}  // namespace unlidar
