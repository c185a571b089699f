// Test-only: frame directories with few returns, and reading them.
#pragma once

#include <string>
#include <vector>

#include "io/frames.hpp"
#include "io/pcd.hpp"
#include "tests/pcd_writer.hpp"
#include "tests/read_recording.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar::testing {

inline constexpr TimeNs kMs = 1'000'000;
inline constexpr TimeNs kSecond = 1'000 * kMs;
inline constexpr TimeNs kUnix = 1'706'255'621 * kSecond;

inline std::string OnePoint(float x = 10.0F) { return BinaryPcd({{x, 0.0F, 0.0F}}); }

// A frame whose returns have times in a field of this type.
inline std::string TimedFrame(const std::vector<double>& times, char type, int size,
                              const std::string& name = "time") {
  TestCloud cloud{{{"x"}, {"y"}, {"z"}, {name, type, size}}, {}};
  for (const double time : times) cloud.values.push_back({10.0, 0.0, 0.0, time});
  return Encoded(cloud, TestEncoding::kBinary);
}

inline Recording Read(const TemporaryFolder& folder, const InputConfig& config = {},
                      const SensorConfig& sensor = {}) {
  return ReadRecording({{"lidar", folder.path()}}, config, {{"lidar", sensor}});
}

inline std::string InputMessage(const TemporaryFolder& folder, const InputConfig& config = {}) {
  try {
    Read(folder, config);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace unlidar::testing
