// Fit of a followed track, and the timing of the frames that it uses.
#include <algorithm>
#include <cmath>
#include <limits>

#include "live/track_follower.hpp"

namespace unlidar {

void TrackFollower::AddToTimings(const Node& node, std::vector<SensorTiming>* timings) const {
  const Plot& plot = PlotOf(node).plot;
  if (plot.sensor >= timings->size()) timings->resize(plot.sensor + 1);
  SensorTiming& known = (*timings)[plot.sensor];
  known.num_returns += static_cast<int>(plot.num_returns);
  if (plot.streak_s == 0.0) return;
  Streak streak;
  streak.length_s = plot.streak_s;
  streak.stamp_s = static_cast<double>(PlotOf(node).stamp_ns - plot.frame_time_ns) * kSecondsPerNs;
  streak.num_returns = static_cast<double>(plot.num_returns);
  streak.scatter_m2 = PlotOf(node).scatter_m2.Full();
  streak.ray_m = plot.ray_m;
  streak.velocity_mps = node.h.state.mean.col(1);
  known.frames.Add(streak, {body_sigma_m_, body_sigma_m_, body_sigma_m_});
}

// Sets bias and common error of the times of the sensor with the most returns, as for a track of a
// recording.
void TrackFollower::UpdateTiming() {
  timings_ = settled_timings_;
  for (std::int32_t k = NewestConfirmed(); k != kNoIndex && k != settled_; k = NodeAt(k).parent) {
    AddToTimings(NodeAt(k), &timings_);
  }
  const auto main =
      std::max_element(timings_.begin(), timings_.end(), By(&SensorTiming::num_returns));
  if (uses_frame_length_) time_bias_ns_ = NsOf(main->frames.TimeBiasS());
  time_sigma_s_ = std::sqrt(main->frames.VarianceS2());
}

void TrackFollower::Fit(TrajectoryFitter& fitter) {
  UpdateTiming();
  fit_.Clear();
  double elevation_m2 = 0.0;
  const std::int32_t head = NewestConfirmed();
  const double from_s =
      settled_ == kNoIndex ? -1e300 : NodeAt(std::min(head, settled_)).h.time_s - kTrackFitS;
  for (std::int32_t k = head; k != kNoIndex; k = NodeAt(k).parent) {
    const Node& node = NodeAt(k);
    if (node.h.time_s < from_s) break;
    fit_.AddEarlier(PlotOf(node), node.h.state.mean.col(1), body_sigma_m_, facing_.mean);
    elevation_m2 += ElevationVarianceM2(PlotOf(node).plot.beam_step_m, body_sigma_m_);
  }
  const TimeNs settled_ns = settled_ == kNoIndex ? std::numeric_limits<TimeNs>::min() / 2
                                                 : PlotOf(NodeAt(settled_)).plot.time_ns;
  fit_.Fit(settled_ns, fitter);
  elevation_sigma_m_ = std::sqrt(elevation_m2 / static_cast<double>(fit_.measurements().size()));
  has_new_plots_ = false;
}

Eigen::Vector3d TrackFollower::PlaceAtM(double time_s) const {
  const Node* before = &NodeAt(BestLeaf());
  while (before->h.time_s > time_s && before->parent != kNoIndex) {
    before = &NodeAt(before->parent);
  }
  const double since_s = time_s - before->h.time_s;
  // The path began earlier, but its older nodes were forgotten: no extrapolation to before them.
  if (since_s < 0.0 && time_s >= first_time_s_) return before->h.state.mean.col(0);
  return before->h.state.mean.col(0) + since_s * before->h.state.mean.col(1);
}

}  // namespace unlidar
