#include "app/trace_output.hpp"

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>
#include <variant>

#include "app/output.hpp"
#include "app/version.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using TraceJson = nlohmann::ordered_json;

// Room for a frame in which every return of a dense sensor is a detection.
constexpr std::size_t kMaxTraceLineBytes = std::size_t{1} << 26;

const char* NameOf(TrackState state) {
  constexpr std::array kNames = {"initiated", "waiting", "confirmed", "rejected", "deleted"};
  return kNames[static_cast<std::size_t>(state)];
}

// Rounds to a thousandth, a millimetre of lengths; null if the value is not finite.
TraceJson NumberJson(double value) {
  constexpr double kPerUnit = 1e3;
  return std::isfinite(value) ? TraceJson(std::round(value * kPerUnit) / kPerUnit)
                              : TraceJson(nullptr);
}

TraceJson PlaceJson(const Eigen::Vector3d& place_m) {
  return TraceJson::array(
      {NumberJson(place_m.x()), NumberJson(place_m.y()), NumberJson(place_m.z())});
}

// The name, or null for kNone.
TraceJson RejectionJson(Rejection rejection) {
  return rejection == Rejection::kNone ? TraceJson(nullptr) : TraceJson(NameOf(rejection));
}

TraceJson FrameJson(const SensorInfo& sensor, const FrameInfo& frame, TraceJson bodies,
                    TraceJson detections) {
  return {{"trace", "frame"},
          {"sensor", sensor.name},
          {"stamp", SecondsText(frame.stamp_ns)},
          {"middle", SecondsText(frame.middle_ns())},
          {"returns", frame.last_return - frame.first_return},
          {"bodies", std::move(bodies)},
          {"detections", std::move(detections)}};
}

TraceJson DetectionJson(const Plot& plot) {
  return {{"x", NumberJson(plot.position_m.x())},  {"y", NumberJson(plot.position_m.y())},
          {"z", NumberJson(plot.position_m.z())},  {"returns", plot.num_returns},
          {"height_m", NumberJson(plot.lowest_m)}, {"log_clutter", NumberJson(plot.log_clutter)},
          {"unsupported", plot.is_floating}};
}

TraceJson DetectionJson(const Plot& plot, const PathVerdict& verdict) {
  TraceJson json = DetectionJson(plot);
  if (verdict.log_likelihood_ratio > 0.0) {
    json["log_likelihood_ratio"] = NumberJson(verdict.log_likelihood_ratio);
  }
  if (verdict.track) {
    json["track"] = *verdict.track;
  } else if (verdict.rejection != Rejection::kNone) {
    json["rejection"] = RejectionJson(verdict.rejection);
  }
  return json;
}

// `plot_of`: the plot of a number in the path.
template <class PlotOf>
TraceJson PathJson(const Path& path, const PlotOf& plot_of, const PathVerdict& verdict,
                   double score_threshold) {
  TraceJson detections = TraceJson::array();
  for (const std::uint32_t i : path.plots) {
    const Plot& plot = plot_of(i);
    detections.push_back(PlaceJson(plot.position_m));
    detections.back().insert(detections.back().begin(), SecondsText(plot.time_ns));
  }
  const TraceJson first = detections.front().front();
  const TraceJson last = detections.back().front();
  return {{"trace", "path"},
          {"first", first},
          {"last", last},
          {"log_likelihood_ratio", NumberJson(verdict.log_likelihood_ratio)},
          {"crowding_penalty", NumberJson(verdict.crowding_penalty)},
          {"threshold", NumberJson(score_threshold)},
          {"rejection", RejectionJson(verdict.rejection)},
          {"detections", std::move(detections)}};
}

// Returns the line with its newline. Bytes that are no UTF-8, as names of folders may be, are
// replaced.
std::string LineOf(const TraceJson& json) {
  return json.dump(-1, ' ', false, TraceJson::error_handler_t::replace) + "\n";
}

std::string HeaderLine(const std::vector<std::string>& sensors) {
  return LineOf(
      {{"trace", "header"}, {"version", kVersion}, {"method", "robust"}, {"sensors", sensors}});
}

TraceJson TracedJson(const TracedFrame& traced) {
  const SceneFrame& frame = traced.frame;
  TraceJson bodies = TraceJson::array();
  for (const Eigen::Vector3f& body_m : frame.bodies_m) {
    bodies.push_back(PlaceJson(body_m.cast<double>()));
  }
  TraceJson detections = TraceJson::array();
  for (std::size_t i = 0; i < frame.plots.size(); ++i) {
    detections.push_back(DetectionJson(frame.plots[i].plot, traced.verdicts[i]));
  }
  TraceJson json = FrameJson(traced.sensor, frame.info, std::move(bodies), std::move(detections));
  json["threshold"] = NumberJson(traced.score_threshold);
  json["rejection"] = RejectionJson(frame.rejection);
  return json;
}

TraceJson TracedJson(const TracedPath& traced) {
  const auto plot_of = [&](std::uint32_t i) -> const Plot& { return traced.seen[i].plot; };
  TraceJson json = PathJson(traced.path, plot_of, traced.verdict, traced.score_threshold);
  TraceJson cuts = TraceJson::array();
  for (const PathCut& cut : traced.cuts) {
    cuts.push_back({RejectionJson(cut.rule), cut.num_plots});
  }
  json["cuts"] = std::move(cuts);
  const std::optional<int>& track = traced.verdict.track;
  json["track"] = track ? TraceJson(*track) : TraceJson(nullptr);
  return json;
}

TraceJson TracedJson(const TracedTrack& traced) {
  return {{"trace", "track"},
          {"at", SecondsText(traced.at_ns)},
          {"track", traced.number},
          {"state", NameOf(traced.state)},
          {"rejection", RejectionJson(traced.rejection)},
          {"first", SecondsText(traced.first_evidence_ns)},
          {"last", SecondsText(traced.last_evidence_ns)}};
}

[[noreturn]] void FailForRoom() {
  throw OutputError("--trace: no room for it in the temporary folder");
}

}  // namespace

TraceOutput::TraceOutput() : file_(std::tmpfile(), &std::fclose) {
  if (!file_) FailForRoom();
}

void TraceOutput::Append(const std::string& line) {
  if (std::fwrite(line.data(), 1, line.size(), file_.get()) != line.size()) FailForRoom();
}

void TraceOutput::Add(const Recording& recording, const SearchTrace& trace) {
  if (written_until_ns_.empty()) {
    std::vector<std::string> names;
    for (const SensorInfo& sensor : recording.sensors) names.push_back(sensor.name);
    Append(HeaderLine(names));
    written_until_ns_.resize(names.size(), std::numeric_limits<TimeNs>::min());
  }
  std::vector<TraceJson> detections(recording.frames.size(), TraceJson::array());
  for (const Plot& plot : trace.plots) detections[plot.frame].push_back(DetectionJson(plot));
  for (std::size_t f = 0; f < recording.frames.size(); ++f) {
    const FrameInfo& frame = recording.frames[f];
    if (frame.stamp_ns <= written_until_ns_[frame.sensor]) continue;
    written_until_ns_[frame.sensor] = frame.stamp_ns;
    TraceJson bodies = TraceJson::array();
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      if (trace.are_bodies[i] == 0) continue;
      bodies.push_back(PlaceJson(recording.points_m[i].cast<double>()));
    }
    Append(LineOf(FrameJson(recording.sensors[frame.sensor], frame, std::move(bodies),
                            std::move(detections[f]))));
  }
  const auto plot_of = [&](std::uint32_t i) -> const Plot& { return trace.plots[i]; };
  for (std::size_t k = 0; k < trace.paths.size(); ++k) {
    PathVerdict verdict = trace.verdicts[k];
    verdict.log_likelihood_ratio = trace.paths[k].score;
    Append(LineOf(PathJson(trace.paths[k], plot_of, verdict, trace.score_threshold)));
  }
}

void TraceOutput::Write(const Sink& sink) const {
  std::array<char, 1 << 16> block;
  std::rewind(file_.get());
  while (const std::size_t size = std::fread(block.data(), 1, block.size(), file_.get())) {
    sink(std::string_view(block.data(), size));
  }
  if (std::ferror(file_.get()) != 0) FailForRoom();
}

LiveTraceOutput::LiveTraceOutput(const std::string& path, Signals& signals,
                                 const NoteCallback& note)
    : file_(path, {"", "{\"trace\":", kMaxTraceLineBytes}, signals, note) {
  AddHeader();
}

LiveTraceSink LiveTraceOutput::Sink() {
  return [this](const LiveTraceEvent& event) {
    file_.Append(LineOf(std::visit([](const auto& traced) { return TracedJson(traced); }, event)));
    if (std::holds_alternative<TracedFrame>(event)) file_.Flush();
  };
}

// Sensors of a stream appear with their frames.
void LiveTraceOutput::AddHeader() {
  file_.Append(HeaderLine({}));
  file_.Flush();
}

}  // namespace unlidar
