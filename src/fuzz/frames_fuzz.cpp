// A folder of frames with any names and any timestamps.csv, as a recording: what is promised of
// one, or an error. The input is a byte of switches, a byte that chooses each file's content, and
// texts that end at a byte of zero: timestamps.csv (none if empty), then file names.
#include <algorithm>
#include <string>
#include <vector>

#include "fuzz/fuzz.hpp"
#include "io/frames.hpp"
#include "io/pcd.hpp"
#include "tests/read_recording.hpp"

namespace unlidar::fuzz {
namespace {

constexpr int kMaxFiles = 8;

std::string WithTimes(const std::string& type, const std::string& times) {
  return "FIELDS x y z t\nSIZE 4 4 4 8\nTYPE F F F " + type + "\nWIDTH 3\nDATA ascii\n1 2 3 " +
         times + "\n0 0 0 -9\nnan 1 1 8\n";
}

// Plain, empty, broken, and with times of each kind.
const std::vector<std::string>& Contents() {
  static const std::vector<std::string> contents = {
      BinaryPcd({{1.0F, 2.0F, 3.0F}, {0.0F, 0.0F, 0.0F}, {0.1F, 0.0F, 0.0F}}),
      BinaryPcd({}),
      "FIELDS x y z\nDATA",
      WithTimes("U", "50000000"),
      WithTimes("I", "-1"),
      WithTimes("F", "0.05"),
      WithTimes("F", "1706255621.6"),
      WithTimes("U", "1706255621600000000"),
      WithTimes("F", "1e300"),
  };
  return contents;
}

bool IsFileName(std::string_view name) {
  return !name.empty() && name != "." && name != ".." && name.size() < 200 &&
         std::all_of(name.begin(), name.end(), [](char c) { return c >= ' ' && c != '/'; });
}

void RequireSound(const Recording& recording) {
  const InputCounts& counts = recording.counts;
  Require(
      recording.points_m.size() == counts.returns && recording.times_ns.size() == counts.returns,
      "all returns are counted");
  Require(counts.rows == counts.returns + counts.no_return_rows + counts.non_finite_rows +
                             counts.out_of_range_rows,
          "every row is a return or was dropped for a reason");
  Require(counts.frames == recording.frames.size() && counts.frames > 0, "all frames are counted");
  std::uint32_t next = 0;
  for (std::size_t i = 0; i < recording.frames.size(); ++i) {
    const FrameInfo& frame = recording.frames[i];
    Require(i == 0 || recording.frames[i - 1].stamp_ns < frame.stamp_ns, "frames are in order");
    Require(frame.begin_ns <= frame.end_ns, "a frame ends after its begin");
    Require(frame.first_return == next && frame.last_return >= next, "returns lie frame by frame");
    next = frame.last_return;
    for (std::uint32_t k = frame.first_return; k < frame.last_return; ++k) {
      Require(frame.begin_ns <= recording.times_ns[k] && recording.times_ns[k] <= frame.end_ns,
              "a return lies in its frame");
      Require(recording.points_m[k].allFinite(), "a return is somewhere");
    }
  }
  Require(next == counts.returns, "every return is in a frame");
  for (const SensorInfo& sensor : recording.sensors) {
    Require(sensor.frame_period_ns > 0, "a sensor has a period");
  }
}

void Run(std::string_view bytes) {
  static const ScratchFolder scratch;
  const std::string folder = scratch.Empty("frames");
  ByteReader reader(bytes);
  const std::uint8_t switches = reader.Byte();
  InputConfig config;
  config.skip_bad_frames = (switches & 1) != 0;
  config.stamp = static_cast<StampMeaning>((switches >> 1) % 3);
  SensorConfig sensor;
  sensor.time_offset_s = (switches & 8) != 0 ? 0.5 : (switches & 16) != 0 ? -1e9 : 0.0;
  std::size_t content = reader.Byte();

  const std::string_view stamps = reader.Line();
  if (!stamps.empty()) WriteFile(folder + "/timestamps.csv", stamps);
  for (int i = 0; i < kMaxFiles && !reader.empty(); ++i) {
    const std::string_view name = reader.Line();
    if (!IsFileName(name)) continue;
    WriteFile(folder + "/" + std::string(name), Contents()[content % Contents().size()]);
    content = content * 5 + 1;
  }

  Recording recording;
  const auto read = [&] {
    recording = ReadRecording({{"fuzz", folder}}, config, {{"fuzz", sensor}});
  };
  if (!Succeeds(read)) return;
  RequireSound(recording);
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
