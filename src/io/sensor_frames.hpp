// Steps from the rows of a frame to its returns in the common frame, shared by recordings and live
// sources. See FrameReader for their definition.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/pose_history.hpp"
#include "base/recording.hpp"
#include "io/frame_directory.hpp"
#include "io/pcd.hpp"
#include "io/point_times.hpp"
#include "io/units.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// One frame, transformed to the common frame by SensorFrames.
struct LoadedFrame {
  FrameFile file;
  PcdCloud cloud;                          // times of all rows; its points were moved out
  std::vector<std::uint32_t> return_rows;  // (N) rows of the returns; none without point times
  std::vector<Eigen::Vector3f> points_m;   // (N)
  std::vector<TimeNs> times_ns;            // (N)
  InputCounts counts;
  FrameInfo info;
};

// Each frame passes through Load(), NoteStamp() and Finish(). The reading of point times and the
// frame period follow from earlier input. In a recording all stamps are noted, and all frames, or
// all of its first part, loaded, before the first frame is finished. A stream finishes frames as
// they come: the first frame with point times decides how they are read, and the last stamps
// determine the period.
class SensorFrames {
 public:
  enum class Source { kRecording, kStream };

  // `index`: of the sensor among all. `reading`: of point times, if known.
  SensorFrames(std::uint32_t index, const std::string& name, const Config& config, Source source,
               std::optional<TimeReading> reading = std::nullopt);

  // Throws InputError unless the stamp is in range with and without the time offset, so that any
  // two times of a recording can be added and subtracted. `name`: of the frame, for messages.
  void CheckStamp(std::string_view name, TimeNs stamp_ns) const;

  // Adds a stamp to the estimate of the frame period, even if its frame is bad. In a stream, stamps
  // are noted in order, as their frames are finished: early or late arrival changes nothing.
  void NoteStamp(TimeNs stamp_ns);

  // Drops rows that are not returns and applies the pose of the sensor: sets all of a frame, whose
  // file is set, but its times. Reuses its memory.
  void Load(PcdCloud cloud, LoadedFrame* frame);

  // True if enough frames were loaded to judge their unit, in a stream within its first seconds.
  bool CanTellUnits() const;

  // Returns why the coordinates of the frames loaded so far cannot be metres, with the sensor's
  // name; empty if they can be, or if it is too early to judge.
  std::optional<std::string> UnitProblem() const;

  // Throws UnitError if there is a UnitProblem().
  void CheckUnits() const;

  // Sets the times and the interval of the frame, and moves its returns to where the carrier was at
  // their times. Returns false if that is not known: the frame is to be left out. Throws InputError
  // for an invalid point time.
  bool Finish(LoadedFrame& frame);

  // Name, origin, and frame period from the stamps so far; valid until the next NoteStamp().
  const SensorInfo& info() const;

  // Returns the warnings about these coordinates, of however few frames. `are_metres`: true if
  // their source states so.
  std::vector<Warning> RangeWarnings(bool are_metres) const;

  // Returns the warning about frames left out for want of a pose, if there are any.
  std::optional<Warning> PoseWarning() const;

  // Appends the warnings about the frames loaded so far.
  void AppendWarnings(bool are_metres, std::vector<Warning>* warnings) const;

  // Added to each stamp.
  TimeNs offset_ns() const { return offset_ns_; }

 private:
  void SetTimes(TimeReading reading, LoadedFrame& frame) const;
  bool Place(LoadedFrame* frame);

  // Members in order of size, so that none is padded.
  SensorConfig sensor_;
  std::optional<PoseHistory> poses_;        // of its carrier, if it moves
  TimeNs offset_ns_;                        // is in range (config_keys.hpp)
  TimeNs returns_for_ns_ = 0;               // from the first frame with returns to the last one
  std::optional<TimeNs> first_return_ns_;   // stamp of the first frame with returns
  std::vector<TimeNs> stamps_ns_;           // ascending; in a stream the newest only
  mutable std::vector<TimeNs> periods_ns_;  // scratch memory for the period
  TimeReadingVote vote_;
  std::optional<Eigen::Vector3d> first_m_;  // position at its first frame, if it moves
  InputConfig input_;
  mutable SensorInfo info_;  // its period is computed on demand
  RangeStatistics ranges_;   // of all returns, including those dropped by range
  std::uint32_t index_;
  Source source_;
  std::optional<TimeReading> reading_;    // once settled
  bool has_unplaced_ = false;             // frames without a pose
  mutable bool is_period_known_ = false;  // false: to be computed from stamps_ns_
};

// Adds the row counts of one frame; `frames` and `bad_frames` are counted elsewhere.
void AddCounts(const InputCounts& from, InputCounts& to);

// Appends frames in order of (stamp, sensor); frees each once its returns are in the recording.
void Merge(std::vector<LoadedFrame> frames, Recording& recording);

}  // namespace unlidar
