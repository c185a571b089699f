#include "live/live_trace.hpp"

#include <algorithm>

#include "base/algorithms.hpp"

namespace unlidar {

void LiveTrace::BeginFrame(const SceneFrame& frame, const RecentPlots& seen,
                           const std::vector<double>& scores, double score_threshold) {
  at_ns_ = frame.info.stamp_ns;
  seen_ = &seen;
  first_ = seen.size() - scores.size();
  score_threshold_ = score_threshold;
  rules_.resize(seen.size(), 0);
  verdicts_.assign(frame.plots.size(), PlotVerdict());
  for (std::size_t i = 0; i < scores.size(); ++i) {
    if (scores[i] <= 0.0) continue;
    verdicts_[i] = {scores[i], Rejection::kBelowThreshold};
  }
}

void LiveTrace::AddPath(const Path& path, const std::vector<PathCut>& cuts,
                        const PathDecision& decision) {
  PlotVerdict& verdict = verdicts_[path.plots.back() - first_];
  if (decision.track) {
    verdict = {decision.log_likelihood_ratio, Rejection::kNone, decision.track};
  } else if (!verdict.track && verdict.rejection == Rejection::kBelowThreshold) {
    verdict = {decision.log_likelihood_ratio, decision.rejection};
  }
  const Rules rule = Rules{1} << static_cast<int>(decision.rejection);
  // Repeated: a path with most of these plots was passed on for the same rule.
  const auto num_known =
      std::count_if(path.plots.begin(), path.plots.end(),
                    [&](std::uint32_t plot) { return (rules_[plot] & rule) != 0; });
  const bool is_repeated = decision.rejection != Rejection::kNone &&
                           2 * static_cast<std::size_t>(num_known) >= path.plots.size();
  rules_[path.plots.back()] |= rule;
  if (is_repeated) return;
  for (const std::uint32_t plot : path.plots) rules_[plot] |= rule;
  sink_(TracedPath{path, *seen_, cuts, decision, score_threshold_});
}

void LiveTrace::AddUnsearched(const SensorInfo& sensor, const FrameInfo& info,
                              std::size_t num_returns) {
  SceneFrame frame;
  frame.info = info;
  frame.info.first_return = 0;
  frame.info.last_return = static_cast<std::uint32_t>(num_returns);
  frame.rejection = Rejection::kWarmUp;
  verdicts_.clear();
  EndFrame(sensor, frame);
}

void LiveTrace::AddTrack(TracedTrack track) {
  if (!is_on()) return;
  track.at_ns = at_ns_;
  sink_(track);
}

void LiveTrace::Forget(std::size_t num_plots) {
  if (!is_on()) return;
  DropFirst(num_plots, &rules_);
}

}  // namespace unlidar
