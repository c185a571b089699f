// Whole recordings, for tests, fuzzers and benchmarks.
#pragma once

#include <limits>
#include <map>
#include <string>
#include <vector>

#include "io/frames.hpp"

namespace unlidar {

inline Recording ReadRecording(const std::vector<FrameSource>& sources, const InputConfig& input,
                               const std::map<std::string, SensorConfig>& sensors,
                               const PosesByName& poses = {}) {
  Config config;
  config.input = input;
  config.sensors = sensors;
  config.poses = poses;
  Recording recording;
  FrameReader(sources, config).ReadUntil(std::numeric_limits<TimeNs>::max(), &recording);
  return recording;
}

}  // namespace unlidar
