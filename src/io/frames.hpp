// Frame directories of one or more LiDARs, merged into one recording.
#pragma once

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "base/recording.hpp"
#include "io/frame_directory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

struct FrameSource {
  std::string name;  // of NAME=DIR, key of `sensors`; empty: last component of the directory
  std::string directory;
};

// Sensor names: letters, digits, '_' and '-', at most kMaxSensorNameBytes.
inline constexpr const char* kExpectedSensorName =
    "expected a name of up to 120 letters, digits, '_' and '-'";
bool IsSensorName(const std::string& name);

// By default the last component of the directory.
std::string SourceName(const FrameSource& source);

// Throws UsageError if two sources have the same name.
void CheckNames(const std::vector<FrameSource>& sources);

// Reads every frame of every source, in parts: the files `*.pcd` of its directory, in order of
// stamp. A sensor that is not in `sensors` is at the origin of the common frame. If `poses` has it
// or its carrier, its returns are moved by the poses of the carrier at their times; a frame without
// these is left out and counted.
//
// Stamps: the rows of `timestamps.csv` (`file,timestamp`) if the directory has one, then for every
// file, read by ParseStamp(); otherwise the file names, read by FrameClock. With and without the
// time offset of the sensor they lie between 1844 and 2096.
//
// Point times: a field for point times is read in one of three ways, the same for all frames of a
// sensor: as an offset from the frame's stamp (whole numbers in nanoseconds, others in seconds), as
// Unix time in that unit, or as Unix time in the unit of its magnitude (NsPerUnitByMagnitude). Each
// return of the first seconds with frames that have any votes for the reading that is nearest to
// its frame's stamp. Farther from it than 1 s and 10 frame periods a return is an error.
//
// The interval of a frame spans its point times; without them it is one frame period long, but at
// most 1 s, is placed about the stamp by config.stamp, and its middle is the time of all returns.
// The frame period is the median difference of a sensor's stamps, up to 1 h; of a single one 0.1 s.
//
// Rows are dropped and counted if they are not finite, (0, 0, 0), or out of range of the sensor,
// input.scale_m applied; then the pose of the sensor is applied in double. A frame without returns
// is valid data.
//
// Throws UsageError for two sources of the same name. Throws InputError for a missing or empty
// directory, a file without a stamp in that range, two frames of one sensor with the same stamp,
// and a frame that cannot be read or has invalid point times; with config.skip_bad_frames such
// frames are skipped and counted. Throws UnitError if the coordinates of a sensor cannot be metres.
class FrameReader {
 public:
  // `config` must outlive it.
  FrameReader(const std::vector<FrameSource>& sources, const Config& config);
  ~FrameReader();

  // Stamps have the time offsets of the sensors applied.
  TimeNs first_stamp_ns() const { return first_stamp_ns_; }
  TimeNs last_stamp_ns() const { return last_stamp_ns_; }

  // Clock that reads the names of the first sensor's frames.
  const FrameClock& first_clock() const;

  // Appends the unread frames with a stamp before `until_ns`; returns the stamp of the next frame
  // after them, the largest TimeNs if there is none.
  TimeNs ReadUntil(TimeNs until_ns, Recording* recording);

 private:
  class SourceReader;

  TimeNs NextStampNs() const;
  void AppendClockWarnings(std::vector<Warning>* warnings) const;

  std::vector<std::unique_ptr<SourceReader>> sources_;
  TimeNs first_stamp_ns_ = std::numeric_limits<TimeNs>::max();
  TimeNs last_stamp_ns_ = std::numeric_limits<TimeNs>::min();
};

}  // namespace unlidar
