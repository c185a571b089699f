#include "app/live_trace_output.hpp"

#include <array>
#include <cstddef>
#include <utility>
#include <variant>

#include "app/output.hpp"
#include "app/trace_lines.hpp"

namespace unlidar {
namespace {

// Room for a frame in which every return of a dense sensor is a detection.
constexpr std::size_t kMaxLineBytes = std::size_t{1} << 26;

const char* NameOf(TrackState state) {
  constexpr std::array kNames = {"initiated", "waiting", "confirmed", "rejected", "deleted"};
  return kNames[static_cast<std::size_t>(state)];
}

TraceJson DetectionJson(const Plot& plot, const PlotVerdict& verdict) {
  TraceJson json = TraceDetection(plot);
  if (verdict.log_likelihood_ratio > 0.0) {
    json["log_likelihood_ratio"] = TraceNumber(verdict.log_likelihood_ratio);
  }
  if (verdict.track) {
    json["track"] = *verdict.track;
  } else if (verdict.rejection != Rejection::kNone) {
    json["rejection"] = TraceRejection(verdict.rejection);
  }
  return json;
}

}  // namespace

LiveTraceOutput::LiveTraceOutput(const std::string& path, Signals& signals,
                                 const NoteCallback& note)
    : file_(path, {"", "{\"trace\":", kMaxLineBytes}, signals, note) {
  AddHeader();
}

LiveTraceSink LiveTraceOutput::Sink() {
  return [this](const LiveTraceEvent& event) {
    std::visit([this](const auto& traced) { Add(traced); }, event);
  };
}

void LiveTraceOutput::Reopen() {
  if (file_.Reopen()) AddHeader();
}

// Sensors of a stream appear with their frames.
void LiveTraceOutput::AddHeader() {
  file_.Append(TraceLine(TraceHeader({})));
  file_.Flush();
}

void LiveTraceOutput::Add(const TracedFrame& traced) {
  const SceneFrame& frame = traced.frame;
  TraceJson bodies = TraceJson::array();
  for (const Eigen::Vector3f& body_m : frame.bodies_m) {
    bodies.push_back(TracePlace(body_m.cast<double>()));
  }
  TraceJson detections = TraceJson::array();
  for (std::size_t i = 0; i < frame.plots.size(); ++i) {
    detections.push_back(DetectionJson(frame.plots[i].plot, traced.verdicts[i]));
  }
  TraceJson json = TraceFrame(traced.sensor, frame.info, std::move(bodies), std::move(detections));
  json["threshold"] = TraceNumber(traced.score_threshold);
  json["rejection"] = TraceRejection(frame.rejection);
  file_.Append(TraceLine(json));
  file_.Flush();
}

void LiveTraceOutput::Add(const TracedPath& traced) {
  TracePathDetections detections;
  for (const std::uint32_t i : traced.path.plots) detections.Add(traced.seen[i].plot);
  const PathDecision& decision = traced.decision;
  TraceJson json = detections.Path(decision.log_likelihood_ratio, decision.crowding_penalty,
                                   traced.score_threshold, decision.rejection);
  TraceJson cuts = TraceJson::array();
  for (const PathCut& cut : traced.cuts) {
    cuts.push_back({TraceRejection(cut.rule), cut.num_plots});
  }
  json["cuts"] = std::move(cuts);
  json["track"] = decision.track ? TraceJson(*decision.track) : TraceJson(nullptr);
  file_.Append(TraceLine(json));
}

void LiveTraceOutput::Add(const TracedTrack& traced) {
  file_.Append(TraceLine({{"trace", "track"},
                          {"at", SecondsText(traced.at_ns)},
                          {"track", traced.number},
                          {"state", NameOf(traced.state)},
                          {"rejection", TraceRejection(traced.rejection)},
                          {"first", SecondsText(traced.first_evidence_ns)},
                          {"last", SecondsText(traced.last_evidence_ns)}}));
}

}  // namespace unlidar
