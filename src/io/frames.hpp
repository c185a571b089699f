// Frame directories of one or more LiDARs, merged into one recording.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/recording.hpp"
#include "io/frame_clock.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

struct FrameSource {
  std::string name;  // of NAME=DIR, key of `sensors`; empty for the last component of the directory
  std::string directory;
};

// A name that `sensors` can hold: letters, digits, '_' and '-', at most kMaxSensorNameBytes.
inline constexpr const char* kExpectedSensorName =
    "expected a name of up to 120 letters, digits, '_' and '-'";
bool IsSensorName(const std::string& name);

// Reads every frame of every source: the files `*.pcd` of its directory, in the order of their
// stamps. A sensor that `sensors` does not name stands at the origin of the common frame.
//
// Stamps: the rows of `timestamps.csv` (`file,timestamp`) if the directory has one, then for every
// file, read by ParseStamp(); else the names of the files, read by FrameClock. With the time offset
// of the sensor as without it, they lie between 1844 and 2096.
//
// Point times: a field for the time of a point is read in one of three ways, for all frames of a
// sensor the same: as an offset from the frame's stamp (whole numbers in nanoseconds, others in
// seconds), as Unix time in that unit, or as Unix time in the unit of its magnitude
// (NsPerUnitByMagnitude). Each return votes for the reading that brings it nearest to its frame's
// stamp. A return farther from the stamp than the larger of 1 s and 10 frame periods is an error.
//
// The interval of a frame spans its point times; without them it is one frame period long, but at
// most 1 s, lies about the stamp as config.stamp says, and all its returns have the time of its
// middle. The frame period is the median difference of a sensor's stamps, at most 1 h, 0.1 s for a
// single frame.
//
// Rows are dropped and counted where they are not finite, (0, 0, 0), or by their range from the
// sensor, input.scale_m applied; then the pose of the sensor is applied in double. A frame without
// returns is data.
//
// Throws UsageError for two sources of one name. Throws InputError for a missing or empty
// directory, a file without a stamp in that range, two frames of one sensor with one stamp, a frame
// that cannot be read or has wrong point times. With config.skip_bad_frames such frames are counted
// and become Recording::bad_frames. Throws UnitError where the coordinates of a sensor can be no
// metres.
Recording ReadRecording(const std::vector<FrameSource>& sources, const InputConfig& config,
                        const std::map<std::string, SensorConfig>& sensors);

// The same in parts, for recordings that are longer than what is looked at at once. How point times
// are read is settled by the frames of the first part that has any.
class FrameReader {
 public:
  FrameReader(const std::vector<FrameSource>& sources, const InputConfig& config,
              const std::map<std::string, SensorConfig>& sensors);
  ~FrameReader();
  FrameReader(const FrameReader&) = delete;
  FrameReader& operator=(const FrameReader&) = delete;

  // Time offsets of the sensors applied.
  TimeNs first_stamp_ns() const;
  TimeNs last_stamp_ns() const;

  // How the names of the first sensor's frames tell time.
  const FrameClock& first_clock() const;

  // Appends the frames with a stamp before `until_ns` that were not read yet, and gives the stamp
  // of the frame that is next then; the largest TimeNs if there is none.
  TimeNs ReadUntil(TimeNs until_ns, Recording* recording);

 private:
  class SourceReader;

  void AppendClockWarnings(std::vector<Warning>* warnings) const;

  InputConfig config_;
  std::vector<std::unique_ptr<SourceReader>> sources_;
};

}  // namespace unlidar
