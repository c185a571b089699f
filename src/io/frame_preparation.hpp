// Steps from the rows of a frame to its returns in the common frame, shared by recordings and
// live sources. See ReadRecording() for their definition.
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

// One frame, transformed to the common frame; SetTimes() completes its times.
struct LoadedFrame {
  FrameFile file;
  PcdCloud cloud;                          // times of all rows; its points were moved out
  std::vector<std::uint32_t> return_rows;  // (N) rows of the returns, only with point times
  std::vector<Eigen::Vector3f> points_m;   // (N)
  std::vector<TimeNs> times_ns;            // (N)
  InputCounts counts;
  RangeStatistics ranges;  // of all returns, including those dropped by range
  FrameInfo info;
};

// Returns the name of a source, by default the last component of its directory.
std::string SourceName(const FrameSource& source);

// Throws UsageError if two sources have the same name.
void CheckNames(const std::vector<FrameSource>& sources);

// Returns the frame period of a sensor from its ascending stamps. `periods_ns`: scratch memory.
TimeNs MedianPeriod(const std::vector<TimeNs>& stamps_ns, std::vector<TimeNs>* periods_ns);

// Returns the time offset of a sensor. Throws ConfigError if it exceeds the range of stamps.
TimeNs OffsetNs(const std::string& name, const SensorConfig& sensor);

// Drops rows that are not returns and applies the pose of the sensor. Sets all of the frame except
// its file; reuses its memory.
void LoadFrame(PcdCloud cloud, const InputConfig& config, const SensorConfig& sensor,
               LoadedFrame* frame);

// Fills info.begin_ns, info.end_ns and times_ns, all without the sensor's time offset. Throws
// InputError for an invalid point time.
void SetTimes(TimeReading reading, TimeNs period_ns, StampMeaning meaning, LoadedFrame& frame);

// Adds the row counts of one frame; `frames` and `bad_frames` are counted elsewhere.
void AddCounts(const InputCounts& from, InputCounts& to);

// Appends frames in order of (stamp, sensor); frees each once its returns are in the recording.
void Merge(std::vector<LoadedFrame> frames, Recording& recording);

}  // namespace unlidar
