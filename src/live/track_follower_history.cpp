// History of a followed track: its fit, its settled plots, the nodes that they need, and what a
// flight followed back in time adds to it.
#include <cmath>
#include <limits>

#include "base/algorithms.hpp"
#include "base/maths.hpp"
#include "live/track_follower.hpp"
#include "scene/support.hpp"
#include "tracking/scan_schedule.hpp"

namespace unlidar {
namespace {

constexpr double kTrackFitS = 6.0;  // length of the fit before the settled plot
constexpr std::int32_t kKept = 0;   // mark of a node
constexpr std::size_t kNoPlot = ~std::size_t{0};

// A flight is followed back only once, so more hypotheses are affordable than kMaxHypotheses. They
// are needed across a pause of seconds among strays, where only the plots before the pause make the
// true hypothesis likelier than the others.
constexpr std::size_t kMaxHypothesesBack = 400;

// Reverses the time of a plot about 0, and the order of frames.
LivePlot InReverse(LivePlot seen) {
  seen.plot = TimeReversed(seen.plot);
  seen.plot.frame = ~seen.plot.frame;
  seen.time_s = -seen.time_s;
  return seen;
}

// Reverses the time of its frame likewise. Sensors may have been added since.
FrameTime FrameTimeInReverse(const Plot& plot, const RecentFrameTimes& frame_times,
                             const std::vector<std::uint32_t>& num_frames) {
  FrameTime at = frame_times.At(plot.frame);
  at.time_s = -at.time_s;
  at.frames_before.resize(num_frames.size(), 0);
  for (std::uint32_t s = 0; s < num_frames.size(); ++s) {
    std::uint32_t& before = at.frames_before[s];
    const std::uint32_t until = before + (s == plot.sensor ? 1U : 0U);
    before = num_frames[s] - std::min(num_frames[s], until);
  }
  return at;
}

}  // namespace

void TrackFollower::AddToTimings(const Node& node, std::vector<SensorTiming>* timings) const {
  const Plot& plot = PlotOf(node).plot;
  if (plot.sensor >= timings->size()) timings->resize(plot.sensor + 1);
  SensorTiming& known = (*timings)[plot.sensor];
  known.num_returns += static_cast<int>(plot.num_returns);
  if (plot.streak_s == 0.0) {
    known.frames.AddTimed(plot.time_sigma_s);
    return;
  }
  Streak streak;
  streak.length_s = plot.streak_s;
  streak.stamp_s = SecondsOf(PlotOf(node).stamp_ns - plot.frame_time_ns);
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
  if (config_->Uses(Rule::kFrameLength)) time_bias_ns_ = NsOf(main->frames.TimeBiasS());
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

void TrackFollower::Settle(TimeNs until_ns, std::vector<LivePlot>* settled) {
  std::int32_t at = NewestConfirmed();
  while (at != kNoIndex && PlotOf(NodeAt(at)).plot.frame_time_ns > until_ns) {
    at = NodeAt(at).parent;
  }
  if (at == kNoIndex || at == settled_) return;
  const auto first = static_cast<std::ptrdiff_t>(settled->size());
  for (std::int32_t k = at; k != kNoIndex && k != settled_; k = NodeAt(k).parent) {
    settled->push_back(PlotOf(NodeAt(k)));
    AddToTimings(NodeAt(k), &settled_timings_);
  }
  std::reverse(settled->begin() + first, settled->end());
  settled_ = at;
  // Deletes the hypotheses that do not pass through the settled node.
  EraseIf(&leaves_, [&](std::int32_t leaf) {
    std::int32_t k = leaf;
    while (k > settled_) k = NodeAt(k).parent;
    return k != settled_;
  });
  for (auto its = settled->begin() + first; its != settled->end(); ++its) {
    AddToBody(*its, NodeAt(at).h.state.mean.col(1));
  }
  Forget();
}

// Adds to width and shape of the body, as BodySpread of a recording has them: across the ray,
// less what the target moves meanwhile. Without point times that is known from the frame alone.
void TrackFollower::AddToBody(const LivePlot& seen, const Eigen::Vector3d& velocity_mps) {
  if (seen.plot.num_returns < 2) return;
  const auto freedom = static_cast<double>(seen.plot.num_returns) - 1.0;
  const Eigen::Vector3d across = AcrossRay(seen.plot.ray_m);
  const double speed_mps = across.dot(velocity_mps);
  const double streak_m2 = across.dot(StreakM2(seen.plot.streak_s, velocity_mps) * across);
  const double prior_m2 = Square(config_->collect.extent_sigma_m);
  const double weight = BodyWeight(prior_m2, streak_m2);
  const double spread_m2 = across.dot(seen.ScatterM2(velocity_mps) * across);
  body_scatter_m2_ += weight * (spread_m2 - freedom * streak_m2);
  body_count_ += weight * freedom;
  body_sigma_m_ = std::sqrt(std::max(body_scatter_m2_, 0.0) / body_count_);
  const double passed_m2 = Square(speed_mps) * static_cast<double>(seen.time_scatter_s2) / freedom;
  if (!config_->Uses(Rule::kRoundBodies)) return;
  if (!ShowsShape(prior_m2, passed_m2 + streak_m2)) return;
  facing_side_.Add(seen.facing_sums);
  facing_ = facing_side_.Share(body_sigma_m_, config_->collect.centroid_offset);
}

std::int32_t TrackFollower::LikeliestEnd() const {
  const auto best =
      std::max_element(nodes_.begin(), nodes_.end(),
                       [](const Node& a, const Node& b) { return a.h.score < b.h.score; });
  return static_cast<std::int32_t>(best - nodes_.begin());
}

std::vector<LivePlot> TrackFollower::LikeliestPath() const {
  std::vector<LivePlot> plots;
  for (std::int32_t at = LikeliestEnd(); at != kNoIndex; at = NodeAt(at).parent) {
    plots.push_back(PlotOf(NodeAt(at)));
  }
  return plots;
}

// Marks a leaf and its ancestors as kept, back to those that are settled and before `from_s`.
void TrackFollower::MarkAncestors(std::int32_t leaf, double from_s) {
  for (std::int32_t k = leaf; k != kNoIndex && scratch_.moved[static_cast<std::size_t>(k)] != kKept;
       k = NodeAt(k).parent) {
    if (k < settled_ && NodeAt(k).h.time_s < from_s) return;
    scratch_.moved[static_cast<std::size_t>(k)] = kKept;
  }
}

// Deletes the nodes that no leaf descends from, with their plots, and those older than the fit
// needs: among strays nearly all lead nowhere. The likeliest path may end at any node until nodes
// are settled.
void TrackFollower::Forget() {
  constexpr std::size_t kMinNodesToCompact = 512;
  if (nodes_.size() < kMinNodesToCompact) return;
  const double from_s = settled_ == kNoIndex ? 0.0 : NodeAt(settled_).h.time_s - kTrackFitS;
  std::vector<std::int32_t>& moved = scratch_.moved;
  moved.reserve(nodes_.capacity());
  moved.assign(nodes_.size(), kNoIndex);
  for (const std::int32_t leaf : leaves_) MarkAncestors(leaf, from_s);
  if (settled_ == kNoIndex) MarkAncestors(LikeliestEnd(), from_s);
  std::vector<std::size_t>& moved_plots = scratch_.moved_plots;
  moved_plots.reserve(plots_.capacity());
  moved_plots.assign(plots_.size(), kNoPlot);
  std::size_t kept = 0;
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    if (moved[k] != kKept) continue;
    Node node = nodes_[k];
    if (node.parent != kNoIndex) node.parent = moved[static_cast<std::size_t>(node.parent)];
    moved[k] = static_cast<std::int32_t>(kept);  // it may be confirmed itself
    node.confirmed = moved[static_cast<std::size_t>(std::max(settled_, node.confirmed))];
    moved_plots[node.plot] = 0;
    nodes_[kept++] = node;
  }
  nodes_.resize(kept);
  num_kept_nodes_ = kept;
  for (std::int32_t& leaf : leaves_) leaf = moved[static_cast<std::size_t>(leaf)];
  if (settled_ != kNoIndex) settled_ = moved[static_cast<std::size_t>(settled_)];
  std::size_t num_plots = 0;
  for (std::size_t i = 0; i < plots_.size(); ++i) {
    if (moved_plots[i] == kNoPlot) continue;
    if (num_plots != i) plots_[num_plots] = std::move(plots_[i]);
    moved_plots[i] = num_plots++;
  }
  plots_.resize(num_plots);
  for (Node& node : nodes_) node.plot = moved_plots[node.plot];
  frame_times_.Forget(plots_.front().plot.frame);
}

std::vector<std::uint32_t> ExtendBackwards(const Flight& flight, const RecentPlots& seen,
                                           const std::vector<char>& are_free,
                                           const RecentFrameTimes& frame_times,
                                           const std::vector<std::uint32_t>& num_frames,
                                           const std::vector<TrackModel>& models,
                                           const RobustConfig& config) {
  Flight back;
  back.log_birth = flight.log_birth;
  for (auto plot = flight.plots.rbegin(); plot != flight.plots.rend(); ++plot) {
    back.plots.push_back(InReverse(*plot));
    back.frame_times.push_back(FrameTimeInReverse(plot->plot, frame_times, num_frames));
  }
  const Plot& first = flight.plots.front().plot;
  TrackFollower follower(back, models, config, kMaxHypothesesBack);
  const bool floats = Floats(flight.plots);
  const auto is_before = [&](const LivePlot& one) {
    return one.plot.frame_time_ns < first.frame_time_ns;
  };
  for (std::size_t end = seen.PartitionPoint(is_before); end > 0;) {
    std::size_t begin = end - 1;
    while (begin > 0 && seen[begin - 1].plot.frame == seen[end - 1].plot.frame) --begin;
    std::vector<LivePlot> plots;
    for (std::size_t i = begin; i < end; ++i) {
      if (!are_free[i]) continue;
      plots.push_back(InReverse(seen[i]));
      const double apart_m = (seen[i].plot.position_m - first.position_m).norm();
      // An unsupported target was unsupported before that was known.
      if (floats && apart_m < kObjectRadiusM) {
        plots.back().plot.log_clutter = seen[i].log_surrounding_clutter;
      }
    }
    end = begin;
    if (plots.empty()) continue;
    follower.Extend(plots, std::vector<char>(plots.size(), 1),
                    FrameTimeInReverse(seen[begin].plot, frame_times, num_frames));
  }
  std::vector<std::uint32_t> past;
  for (const LivePlot& one : follower.LikeliestPath()) {
    const auto is_same_plot = [&](const LivePlot& other) {
      return other.plot.frame == ~one.plot.frame && other.plot.position_m == one.plot.position_m;
    };
    std::uint32_t at = 0;
    while (at < seen.size() && !is_same_plot(seen[at])) ++at;
    if (at < seen.size() && is_before(seen[at])) past.push_back(at);
  }
  std::sort(past.begin(), past.end());
  return past;
}

}  // namespace unlidar
