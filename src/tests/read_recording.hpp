// Whole recordings, for tests, fuzzers and benchmarks.
#pragma once

#include <limits>
#include <map>
#include <string>
#include <vector>

#include "io/frames.hpp"

namespace unlidar {

inline Recording ReadRecording(const std::vector<FrameSource>& sources, const InputConfig& config,
                               const std::map<std::string, SensorConfig>& sensors,
                               const PosesByName& poses = {}) {
  Recording recording;
  FrameReader(sources, config, sensors, poses)
      .ReadUntil(std::numeric_limits<TimeNs>::max(), &recording);
  return recording;
}

}  // namespace unlidar
