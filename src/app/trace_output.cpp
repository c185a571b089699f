#include "app/trace_output.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "app/output.hpp"
#include "app/version.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kPerUnit = 1e3;  // numbers are to the millimetre, or a thousandth

Json Rounded(double value) {
  return std::isfinite(value) ? Json(std::round(value * kPerUnit) / kPerUnit) : Json(nullptr);
}

Json PositionJson(const Eigen::Vector3d& place_m) {
  return Json::array({Rounded(place_m.x()), Rounded(place_m.y()), Rounded(place_m.z())});
}

Json DetectionJson(const Plot& plot) {
  return {{"x", Rounded(plot.position_m.x())},  {"y", Rounded(plot.position_m.y())},
          {"z", Rounded(plot.position_m.z())},  {"returns", plot.num_returns},
          {"height_m", Rounded(plot.lowest_m)}, {"log_clutter", Rounded(plot.log_clutter)},
          {"unsupported", plot.is_floating}};
}

Json PathJson(const Path& path, const PathVerdict& verdict, const SearchTrace& trace) {
  Json detections = Json::array();
  for (const std::uint32_t i : path.plots) {
    const Plot& plot = trace.plots[i];
    Json detection = PositionJson(plot.position_m);
    detection.insert(detection.begin(), SecondsText(plot.time_ns));
    detections.push_back(std::move(detection));
  }
  const bool is_track = verdict.rejection == Rejection::kNone;
  return {{"trace", "path"},
          {"first", SecondsText(trace.plots[path.plots.front()].time_ns)},
          {"last", SecondsText(trace.plots[path.plots.back()].time_ns)},
          {"log_likelihood_ratio", Rounded(path.score)},
          {"crowding_penalty", Rounded(verdict.crowding_penalty)},
          {"threshold", Rounded(trace.score_threshold)},
          {"rejection", is_track ? Json(nullptr) : Json(NameOf(verdict.rejection))},
          {"detections", std::move(detections)}};
}

[[noreturn]] void Fail() { throw OutputError("--trace: no room for it in the temporary folder"); }

}  // namespace

TraceOutput::TraceOutput() : file_(std::tmpfile(), &std::fclose) {
  if (!file_) Fail();
}

void TraceOutput::Append(const std::string& line) {
  if (std::fwrite(line.data(), 1, line.size(), file_.get()) != line.size() ||
      std::fputc('\n', file_.get()) == EOF) {
    Fail();
  }
}

void TraceOutput::Add(const Recording& recording, const SearchTrace& trace) {
  if (!has_header_) {
    Json names = Json::array();
    for (const SensorInfo& sensor : recording.sensors) names.push_back(sensor.name);
    Append(Json({{"trace", "header"},
                 {"version", kVersion},
                 {"method", "robust"},
                 {"sensors", std::move(names)}})
               .dump());
    has_header_ = true;
  }
  AddFrames(recording, trace);
  AddPaths(trace);
}

void TraceOutput::AddFrames(const Recording& recording, const SearchTrace& trace) {
  written_until_ns_.resize(recording.sensors.size(), std::numeric_limits<TimeNs>::min());
  std::vector<Json> detections(recording.frames.size(), Json::array());
  for (const Plot& plot : trace.plots) detections[plot.frame].push_back(DetectionJson(plot));
  for (std::size_t f = 0; f < recording.frames.size(); ++f) {
    const FrameInfo& frame = recording.frames[f];
    if (frame.stamp_ns <= written_until_ns_[frame.sensor]) continue;
    written_until_ns_[frame.sensor] = frame.stamp_ns;
    Json bodies = Json::array();
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      if (trace.are_bodies[i] == 0) continue;
      bodies.push_back(PositionJson(recording.points_m[i].cast<double>()));
    }
    Append(Json({{"trace", "frame"},
                 {"sensor", recording.sensors[frame.sensor].name},
                 {"stamp", SecondsText(frame.stamp_ns)},
                 {"middle", SecondsText(frame.middle_ns())},
                 {"returns", frame.last_return - frame.first_return},
                 {"bodies", std::move(bodies)},
                 {"detections", std::move(detections[f])}})
               .dump());
  }
}

void TraceOutput::AddPaths(const SearchTrace& trace) {
  for (std::size_t k = 0; k < trace.paths.size(); ++k) {
    Append(PathJson(trace.paths[k], trace.verdicts[k], trace).dump());
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
