#include "app/trace_lines.hpp"

#include <cmath>
#include <utility>

#include "app/output.hpp"
#include "app/version.hpp"

namespace unlidar {
namespace {

constexpr double kPerUnit = 1e3;

}  // namespace

TraceJson TraceNumber(double value) {
  return std::isfinite(value) ? TraceJson(std::round(value * kPerUnit) / kPerUnit)
                              : TraceJson(nullptr);
}

TraceJson TracePlace(const Eigen::Vector3d& place_m) {
  return TraceJson::array(
      {TraceNumber(place_m.x()), TraceNumber(place_m.y()), TraceNumber(place_m.z())});
}

TraceJson TraceRejection(Rejection rejection) {
  return rejection == Rejection::kNone ? TraceJson(nullptr) : TraceJson(NameOf(rejection));
}

TraceJson TraceHeader(const std::vector<std::string>& sensors) {
  return {{"trace", "header"}, {"version", kVersion}, {"method", "robust"}, {"sensors", sensors}};
}

TraceJson TraceFrame(const SensorInfo& sensor, const FrameInfo& frame, TraceJson bodies,
                     TraceJson detections) {
  return {{"trace", "frame"},
          {"sensor", sensor.name},
          {"stamp", SecondsText(frame.stamp_ns)},
          {"middle", SecondsText(frame.middle_ns())},
          {"returns", frame.last_return - frame.first_return},
          {"bodies", std::move(bodies)},
          {"detections", std::move(detections)}};
}

TraceJson TraceDetection(const Plot& plot) {
  return {{"x", TraceNumber(plot.position_m.x())},  {"y", TraceNumber(plot.position_m.y())},
          {"z", TraceNumber(plot.position_m.z())},  {"returns", plot.num_returns},
          {"height_m", TraceNumber(plot.lowest_m)}, {"log_clutter", TraceNumber(plot.log_clutter)},
          {"unsupported", plot.is_floating}};
}

void TracePathDetections::Add(const Plot& plot) {
  TraceJson detection = TracePlace(plot.position_m);
  detection.insert(detection.begin(), SecondsText(plot.time_ns));
  detections_.push_back(std::move(detection));
}

TraceJson TracePathDetections::Path(double log_likelihood_ratio, double crowding_penalty,
                                    double score_threshold, Rejection rejection) {
  TraceJson first = detections_.front().front();
  TraceJson last = detections_.back().front();
  return {{"trace", "path"},
          {"first", std::move(first)},
          {"last", std::move(last)},
          {"log_likelihood_ratio", TraceNumber(log_likelihood_ratio)},
          {"crowding_penalty", TraceNumber(crowding_penalty)},
          {"threshold", TraceNumber(score_threshold)},
          {"rejection", TraceRejection(rejection)},
          {"detections", std::move(detections_)}};
}

std::string TraceLine(const TraceJson& json) {
  return json.dump(-1, ' ', false, TraceJson::error_handler_t::replace) + "\n";
}

}  // namespace unlidar
