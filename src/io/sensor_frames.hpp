// The frames of one sensor, made ready for the stages.
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

// Each frame goes through Load(), NoteStamp() and Finish(). How point times are read, and the frame
// period, follow from what came before: of a recording all stamps are noted and all frames, or all
// of its first part, loaded before the first is finished. A stream finishes frames while others
// come: the first frame with point times decides how they are read, and the last stamps give the
// period.
class SensorFrames {
 public:
  enum class Source { kRecording, kStream };

  // `index` of the sensor among all. `reading`: of point times, where it is known. Throws
  // ConfigError for a time offset that no stamp can bear.
  SensorFrames(std::uint32_t index, const std::string& name, const InputConfig& input,
               const SensorConfig& sensor, Source source = Source::kRecording,
               std::optional<TimeReading> reading = std::nullopt);

  // Throws InputError unless a stamp is one with the time offset applied as well as without it: any
  // two times of a recording may be added and subtracted.
  // `name`: what messages call the frame.
  void CheckStamp(std::string_view name, TimeNs stamp_ns) const;

  // One counts for the frame period even if its frame is bad. Of a stream, stamps are noted when
  // their frames are finished, in order: so what came late or early changes nothing.
  void NoteStamp(TimeNs stamp_ns);

  // Sets the returns of a frame, whose file is set, in the common frame and without times. Its
  // memory is used again.
  void Load(PcdCloud cloud, LoadedFrame* frame);

  // Whether enough frames were loaded to tell their unit; of a stream within its first seconds
  // alone.
  bool CanTellUnits() const;

  // Why the coordinates of the frames loaded so far can be no metres, with the name; empty where
  // they can be, or it cannot be told.
  std::optional<std::string> UnitProblem() const;

  // Throws UnitError for that.
  void CheckUnits() const;

  // Sets the times and the interval of the frame. Throws InputError for a point time that is none.
  void Finish(LoadedFrame& frame);

  // Name, origin, and frame period by the stamps so far, until the next.
  const SensorInfo& info() const;

  // The doubts in these coordinates, of however few frames. `are_metres`: as their source states.
  std::vector<Warning> RangeWarnings(bool are_metres) const;

  // Appends what the frames loaded so far leave in doubt.
  void AppendWarnings(bool are_metres, std::vector<Warning>* warnings) const;

  // Added to each stamp.
  TimeNs offset_ns() const { return offset_ns_; }

 private:
  std::uint32_t index_;
  InputConfig input_;
  SensorConfig sensor_;
  Source source_;
  TimeNs offset_ns_;
  std::vector<TimeNs> stamps_ns_;           // ascending; of a stream the newest
  mutable SensorInfo info_;                 // its period of these stamps,
  mutable bool is_period_known_ = false;    // once it was asked for,
  mutable std::vector<TimeNs> periods_ns_;  // and what it is found in
  RangeStatistics ranges_;
  std::optional<TimeNs> first_return_ns_;  // stamp of the first frame that has any,
  TimeNs returns_for_ns_ = 0;              // and how long the last one came after it
  TimeReadingVote vote_;
  std::optional<TimeReading> reading_;  // once it is settled
};

}  // namespace unlidar
