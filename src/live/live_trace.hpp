// Measurements and decisions of a stream, for --trace.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "base/algorithms.hpp"
#include "base/recording.hpp"
#include "live/live_plot.hpp"
#include "live/live_scene.hpp"
#include "tracking/rejection.hpp"
#include "tracking/tracker.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// A frame, after the decisions of its search.
struct TracedFrame {
  const SensorInfo& sensor;
  const SceneFrame& frame;
  const std::vector<PathVerdict>& verdicts;  // (plots)
  double score_threshold;
};

// A path at or above the score threshold.
struct TracedPath {
  const Path& path;
  const RecentPlots& seen;           // recent plots, which it indexes
  const std::vector<PathCut>& cuts;  // of its plots, from the first on
  const PathVerdict& verdict;
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
                  const std::vector<double>& scores, double score_threshold) {
    at_ns_ = frame.info.stamp_ns;
    seen_ = &seen;
    first_ = seen.size() - scores.size();
    score_threshold_ = score_threshold;
    rules_.resize(seen.size(), 0);
    verdicts_.assign(frame.plots.size(), PathVerdict());
    for (std::size_t i = 0; i < scores.size(); ++i) {
      if (scores[i] > 0.0) verdicts_[i] = {scores[i], 0.0, Rejection::kBelowThreshold};
    }
  }
  void SetTrack(std::size_t plot, std::optional<int> track) { verdicts_[plot].track = track; }
  void AddPath(const Path& path, const std::vector<PathCut>& cuts, const PathVerdict& verdict) {
    PathVerdict& of_last = verdicts_[path.plots.back() - first_];
    const bool is_first = !of_last.track && of_last.rejection == Rejection::kBelowThreshold;
    if (verdict.track || is_first) of_last = verdict;
    const Rules rule = Rules{1} << static_cast<int>(verdict.rejection);
    // Repeated: a path with most of these plots was passed on for the same rule.
    const auto num_known =
        std::count_if(path.plots.begin(), path.plots.end(),
                      [&](std::uint32_t plot) { return (rules_[plot] & rule) != 0; });
    const bool is_repeated = verdict.rejection != Rejection::kNone &&
                             2 * static_cast<std::size_t>(num_known) >= path.plots.size();
    rules_[path.plots.back()] |= rule;
    if (is_repeated) return;
    for (const std::uint32_t plot : path.plots) rules_[plot] |= rule;
    sink_(TracedPath{path, *seen_, cuts, verdict, score_threshold_});
  }
  void EndFrame(const SensorInfo& sensor, const SceneFrame& frame) {
    sink_(TracedFrame{sensor, frame, verdicts_, score_threshold_});
  }

  // A frame that yields no plots, because its station is still learning.
  void AddUnsearched(const SensorInfo& sensor, const FrameInfo& info, std::size_t num_returns) {
    SceneFrame frame;
    frame.info = info;
    frame.info.first_return = 0;
    frame.info.last_return = static_cast<std::uint32_t>(num_returns);
    frame.rejection = Rejection::kWarmUp;
    verdicts_.clear();
    EndFrame(sensor, frame);
  }

  void AddTrack(TracedTrack track) {
    track.at_ns = at_ns_;
    if (is_on()) sink_(track);
  }

  // The first plots of `seen` are gone.
  void Forget(std::size_t num_plots) {
    if (is_on()) DropFirst(num_plots, &rules_);
  }

 private:
  using Rules = std::uint32_t;  // a bit for each Rejection

  LiveTraceSink sink_;
  TimeNs at_ns_ = 0;
  const RecentPlots* seen_ = nullptr;
  std::size_t first_ = 0;  // index in seen_ of the first plot of the frame
  double score_threshold_ = 0.0;
  std::vector<PathVerdict> verdicts_;  // (plots of the frame)
  std::vector<Rules> rules_;           // (seen) that refused paths through a plot
};

}  // namespace unlidar
