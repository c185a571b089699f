// Prepares the frames of one sensor for the stages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/frame_preparation.hpp"

namespace unlidar {

// Each frame passes through Load(), NoteStamp() and Finish(). The reading of point times and the
// frame period follow from earlier input. In a recording all stamps are noted, and all frames, or
// all of its first part, loaded, before the first frame is finished. A stream finishes frames as
// they come: the first frame with point times decides how they are read, and the last stamps
// determine the period.
class SensorFrames {
 public:
  enum class Source { kRecording, kStream };

  // `index`: of the sensor among all. `reading`: of point times, if known. Throws ConfigError for a
  // time offset beyond the range of stamps.
  SensorFrames(std::uint32_t index, const std::string& name, const InputConfig& input,
               const SensorConfig& sensor, Source source = Source::kRecording,
               std::optional<TimeReading> reading = std::nullopt);

  // Throws InputError unless the stamp is in range with and without the time offset, so that any
  // two times of a recording can be added and subtracted. `name`: of the frame, for messages.
  void CheckStamp(std::string_view name, TimeNs stamp_ns) const;

  // Adds a stamp to the estimate of the frame period, even if its frame is bad. In a stream, stamps
  // are noted in order, when their frames are finished, so that early or late arrival changes
  // nothing.
  void NoteStamp(TimeNs stamp_ns);

  // Sets the returns of a frame, whose file is set, in the common frame and without times. Reuses
  // its memory.
  void Load(PcdCloud cloud, LoadedFrame* frame);

  // True if enough frames were loaded to judge their unit; in a stream only within its first
  // seconds.
  bool CanTellUnits() const;

  // Returns why the coordinates of the frames loaded so far cannot be metres, with the sensor's
  // name; empty if they can be, or if it is too early to judge.
  std::optional<std::string> UnitProblem() const;

  // Throws UnitError if there is a UnitProblem().
  void CheckUnits() const;

  // Sets the times and the interval of the frame. Throws InputError for an invalid point time.
  void Finish(LoadedFrame& frame);

  // Name, origin, and frame period from the stamps so far; valid until the next NoteStamp().
  const SensorInfo& info() const;

  // Returns the warnings about these coordinates, from however few frames. `are_metres`: true if
  // their source states so.
  std::vector<Warning> RangeWarnings(bool are_metres) const;

  // Appends the warnings about the frames loaded so far.
  void AppendWarnings(bool are_metres, std::vector<Warning>* warnings) const;

  // Time offset added to each stamp.
  TimeNs offset_ns() const { return offset_ns_; }

 private:
  std::uint32_t index_;
  InputConfig input_;
  SensorConfig sensor_;
  Source source_;
  TimeNs offset_ns_;
  std::vector<TimeNs> stamps_ns_;           // ascending; in a stream the newest only
  mutable SensorInfo info_;                 // its period is computed on demand
  mutable bool is_period_known_ = false;    // false: to be computed from stamps_ns_
  mutable std::vector<TimeNs> periods_ns_;  // scratch memory for that
  RangeStatistics ranges_;
  std::optional<TimeNs> first_return_ns_;  // stamp of the first frame with returns
  TimeNs returns_for_ns_ = 0;              // from then to the last frame with returns
  TimeReadingVote vote_;
  std::optional<TimeReading> reading_;  // once settled
};

}  // namespace unlidar
