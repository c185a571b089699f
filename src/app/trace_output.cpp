#include "app/trace_output.hpp"

#include <array>
#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "app/trace_lines.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

TraceJson PathJson(const Path& path, const PathVerdict& verdict, const SearchTrace& trace) {
  TracePathDetections detections;
  for (const std::uint32_t i : path.plots) detections.Add(trace.plots[i]);
  return detections.Path(path.score, verdict.crowding_penalty, trace.score_threshold,
                         verdict.rejection);
}

[[noreturn]] void Fail() { throw OutputError("--trace: no room for it in the temporary folder"); }

}  // namespace

TraceOutput::TraceOutput() : file_(std::tmpfile(), &std::fclose) {
  if (!file_) Fail();
}

void TraceOutput::Append(const std::string& line) {
  if (std::fwrite(line.data(), 1, line.size(), file_.get()) != line.size()) Fail();
}

void TraceOutput::Add(const Recording& recording, const SearchTrace& trace) {
  if (!has_header_) {
    std::vector<std::string> names;
    for (const SensorInfo& sensor : recording.sensors) names.push_back(sensor.name);
    Append(TraceLine(TraceHeader(names)));
    has_header_ = true;
  }
  AddFrames(recording, trace);
  AddPaths(trace);
}

void TraceOutput::AddFrames(const Recording& recording, const SearchTrace& trace) {
  written_until_ns_.resize(recording.sensors.size(), std::numeric_limits<TimeNs>::min());
  std::vector<TraceJson> detections(recording.frames.size(), TraceJson::array());
  for (const Plot& plot : trace.plots) detections[plot.frame].push_back(TraceDetection(plot));
  for (std::size_t f = 0; f < recording.frames.size(); ++f) {
    const FrameInfo& frame = recording.frames[f];
    if (frame.stamp_ns <= written_until_ns_[frame.sensor]) continue;
    written_until_ns_[frame.sensor] = frame.stamp_ns;
    TraceJson bodies = TraceJson::array();
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      if (trace.are_bodies[i] == 0) continue;
      bodies.push_back(TracePlace(recording.points_m[i].cast<double>()));
    }
    Append(TraceLine(TraceFrame(recording.sensors[frame.sensor], frame, std::move(bodies),
                                std::move(detections[f]))));
  }
}

void TraceOutput::AddPaths(const SearchTrace& trace) {
  for (std::size_t k = 0; k < trace.paths.size(); ++k) {
    Append(TraceLine(PathJson(trace.paths[k], trace.verdicts[k], trace)));
  }
}

void TraceOutput::Write(const Sink& sink) const {
  std::array<char, 1 << 16> block;
  std::rewind(file_.get());
  while (const std::size_t size = std::fread(block.data(), 1, block.size(), file_.get())) {
    sink(std::string_view(block.data(), size));
  }
  if (std::ferror(file_.get()) != 0) Fail();
}

}  // namespace unlidar
