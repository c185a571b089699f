// The lines of --trace, of recordings and of streams: JSON objects, one a line. Their members are
// in docs/explain.md.
#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/rejection.hpp"

namespace unlidar {

using TraceJson = nlohmann::ordered_json;

// Rounds to a thousandth, a millimetre of lengths; null if the value is not finite.
TraceJson TraceNumber(double value);

TraceJson TracePlace(const Eigen::Vector3d& place_m);

// The name, or null for kNone.
TraceJson TraceRejection(Rejection rejection);

TraceJson TraceHeader(const std::vector<std::string>& sensors);

TraceJson TraceFrame(const SensorInfo& sensor, const FrameInfo& frame, TraceJson bodies,
                     TraceJson detections);

TraceJson TraceDetection(const Plot& plot);

// Takes the plots of a path one after the other.
class TracePathDetections {
 public:
  void Add(const Plot& plot);

  // The line of their path.
  TraceJson Path(double log_likelihood_ratio, double crowding_penalty, double score_threshold,
                 Rejection rejection);

 private:
  TraceJson detections_ = TraceJson::array();
};

// Returns the line with its newline. Bytes that are no UTF-8, as names of folders may be, are
// replaced.
std::string TraceLine(const TraceJson& json);

}  // namespace unlidar
