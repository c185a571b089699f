// The steps from the rows of a frame to its returns in the common frame, shared by recordings and
// live sources. ReadRecording() says what they do.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "base/recording.hpp"
#include "io/frame_directory.hpp"
#include "io/frames.hpp"
#include "io/pcd.hpp"
#include "io/point_times.hpp"
#include "io/units.hpp"

namespace unlidar {

// A frame in the common frame, its times still to be told.
struct LoadedFrame {
  FrameFile file;
  PcdCloud cloud;                          // times of all rows; the points have moved on
  std::vector<std::uint32_t> return_rows;  // (N) rows of the returns, only with point times
  std::vector<Eigen::Vector3f> points_m;   // (N)
  std::vector<TimeNs> times_ns;            // (N)
  InputCounts counts;
  RangeStatistics ranges;  // of all returns, also of those that are dropped for their range
  FrameInfo info;
};

// The name of a source, by default the last component of its directory.
std::string SourceName(const FrameSource& source);

// Throws UsageError for two sources of one name.
void CheckNames(const std::vector<FrameSource>& sources);

// The frame period of a sensor with these stamps, which ascend.
// `periods_ns`: memory to work in.
TimeNs MedianPeriod(const std::vector<TimeNs>& stamps_ns, std::vector<TimeNs>* periods_ns);

// The time offset of a sensor. Throws ConfigError for one that no stamp can bear.
TimeNs OffsetNs(const std::string& name, const SensorConfig& sensor);

// Drops the rows that are no returns and applies the pose of the sensor. Sets all of the frame but
// its file, in the memory that it has.
void LoadFrame(PcdCloud cloud, const InputConfig& config, const SensorConfig& sensor,
               LoadedFrame* frame);

// Fills info.begin_ns, info.end_ns and times_ns, all without the sensor's time offset. Throws
// InputError for a point time that is none.
void SetTimes(TimeReading reading, TimeNs period_ns, StampMeaning meaning, LoadedFrame& frame);

// Adds the rows of one frame; `frames` and `bad_frames` are counted elsewhere.
void AddCounts(const InputCounts& from, InputCounts& to);

// Frames in the order of (stamp, sensor), each freed once its returns are in the recording.
void Merge(std::vector<LoadedFrame> frames, Recording& recording);

}  // namespace unlidar
