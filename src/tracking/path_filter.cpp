#include "tracking/path_filter.hpp"

#include <utility>

namespace unlidar {

std::vector<Hypothesis> FilterFrom(const TrackModel& model, const Hypothesis& from,
                                   const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, std::size_t first) {
  std::vector<Hypothesis> hypotheses;
  hypotheses.reserve(plots.size() - first + 1);
  hypotheses.push_back(from);
  for (std::size_t k = first; k < plots.size(); ++k) {
    hypotheses.push_back(model.PredictAndUpdate(hypotheses.back(), *plots[k], frame_times[k]));
  }
  return hypotheses;
}

std::vector<Hypothesis> FilterPath(const TrackModel& model, const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, double log_birth,
                                   const TrackerConfig& config) {
  std::vector<Hypothesis> best;
  for (const double speed_mps : config.birth_speeds_mps) {
    const Hypothesis birth = model.Birth(*plots.front(), log_birth, frame_times.front(), speed_mps);
    std::vector<Hypothesis> hypotheses = FilterFrom(model, birth, plots, frame_times, 1);
    if (best.empty() || hypotheses.back().score > best.back().score) best = std::move(hypotheses);
  }
  return best;
}

}  // namespace unlidar
