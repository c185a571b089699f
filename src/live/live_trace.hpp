// Measurements and decisions of a stream, for --trace.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "base/recording.hpp"
#include "live/live_plot.hpp"
#include "live/live_scene.hpp"
#include "tracking/rejection.hpp"
#include "tracking/tracker.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Decision on a plot.
struct PlotVerdict {
  double log_likelihood_ratio = 0.0;       // of the best path to it; 0 without one
  Rejection rejection = Rejection::kNone;  // of the path that came farthest
  std::optional<int> track = {};           // that has the plot
};

// A frame, after the decisions of its search.
struct TracedFrame {
  const SensorInfo& sensor;
  const SceneFrame& frame;
  const std::vector<PlotVerdict>& verdicts;  // (plots)
  double score_threshold;
};

// Decision on a path at or above the score threshold.
struct PathDecision {
  double log_likelihood_ratio = 0.0;  // of its flying part, if that was scored
  double crowding_penalty = 0.0;
  Rejection rejection = Rejection::kNone;
  std::optional<int> track = {};  // that it became, without a rejection
};

struct TracedPath {
  const Path& path;
  const RecentPlots& seen;           // recent plots, which it indexes
  const std::vector<PathCut>& cuts;  // of its plots, from the first on
  const PathDecision& decision;
  double score_threshold;
};

// A track waits for rows while it may be no drone, for the reason of the rejection.
enum class TrackState { kInitiated, kWaiting, kConfirmed, kRejected, kDeleted };

struct TracedTrack {
  TimeNs at_ns = 0;  // stamp of the last frame searched
  int number = 0;    // in order of initiation
  TrackState state = TrackState::kInitiated;
  Rejection rejection = Rejection::kNone;
  TimeNs first_evidence_ns = 0;
  TimeNs last_evidence_ns = 0;
};

// References are valid during the call only.
using LiveTraceEvent = std::variant<TracedFrame, TracedPath, TracedTrack>;
using LiveTraceSink = std::function<void(const LiveTraceEvent&)>;

// Passes the decisions of a stream on. A path that grows from frame to frame is passed on once for
// each rule that refuses it, and each of its plots has the decision of its frame.
class LiveTrace {
 public:
  // `sink` may be empty: nothing is traced then.
  explicit LiveTrace(LiveTraceSink sink) : sink_(std::move(sink)) {}

  bool is_on() const { return static_cast<bool>(sink_); }

  // Begins a frame. `seen`: recent plots; those of a frame that is searched are the last ones.
  // `scores` (plots): of the best path to each; empty without a search.
  void BeginFrame(const SceneFrame& frame, const RecentPlots& seen,
                  const std::vector<double>& scores, double score_threshold);
  void SetTrack(std::size_t plot, std::optional<int> track) { verdicts_[plot].track = track; }
  void AddPath(const Path& path, const std::vector<PathCut>& cuts, const PathDecision& decision);
  void EndFrame(const SensorInfo& sensor, const SceneFrame& frame) {
    sink_(TracedFrame{sensor, frame, verdicts_, score_threshold_});
  }

  // A frame that yields no plots, because its station is still learning.
  void AddUnsearched(const SensorInfo& sensor, const FrameInfo& info, std::size_t num_returns);

  void AddTrack(TracedTrack track);

  // The first plots of `seen` are gone.
  void Forget(std::size_t num_plots);

 private:
  using Rules = std::uint32_t;  // a bit for each Rejection

  LiveTraceSink sink_;
  TimeNs at_ns_ = 0;
  const RecentPlots* seen_ = nullptr;
  std::size_t first_ = 0;  // index in seen_ of the first plot of the frame
  double score_threshold_ = 0.0;
  std::vector<PlotVerdict> verdicts_;  // (plots of the frame)
  std::vector<Rules> rules_;           // (seen) that refused paths through a plot
};

}  // namespace unlidar
