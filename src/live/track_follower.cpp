#include "live/track_follower.hpp"

#include <cmath>
#include <limits>

#include "base/algorithms.hpp"
#include "base/recording.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {
namespace {

constexpr double kMaxCoastS = 1.0;  // after it a track must be reacquired
// Log-likelihood gain over the newest confirmed detection, net of missed ones, needed to confirm a
// later one. To reacquire a track: at most one pause in twenty is the end of the target; clutter
// alone then reaches this gain with probability <= e^-2. Before that: a target that was seen in
// every frame and from now on only once in several has rather ended, and strays are seen.
constexpr double kReacquisitionGain = 2.0;
constexpr double kContinuationGain = -1.0;
constexpr double kGateSigmas = 6.0;
// Log of the probability that a target is of one other agility from a plot on: some minutes pass
// until it is. Higher ones let strays behind a gap pass for a manoeuvre.
constexpr double kAgilityChangeLog = -8.0;

}  // namespace

std::vector<std::pair<std::size_t, Hypothesis>> RejoinedPlots(
    const TrackModel& model, const Hypothesis& confirmed, const std::vector<FollowedPlot>& plots) {
  const TrackModel judge = model.With(TimeOutOfView::kLogUniform);
  const auto way_of = [&](const Members& members) {
    std::vector<std::pair<std::size_t, Hypothesis>> way;
    Hypothesis h = confirmed;
    for (const std::uint32_t i : members) {
      h = judge.PredictAndUpdate(h, plots[i].seen.plot, plots[i].at);
      way.emplace_back(i, h);
    }
    return way;
  };
  const auto with_score = [&](Members members) {
    const double score = way_of(members).back().second.score;
    return Path{std::move(members), score};
  };
  Path path = with_score(NumbersBelow(plots.size()));
  const auto without = [&](std::size_t first, std::size_t last) {
    Members rest = path.plots;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(first),
               rest.begin() + static_cast<std::ptrdiff_t>(last));
    return with_score(std::move(rest));
  };
  while (DropStretch([&](std::uint32_t i) { return plots[i].seen.plot.time_ns; }, without,
                     Droppable::kRunsBeforeLast, &path)) {
  }
  return way_of(path.plots);
}

TrackFollower::TrackFollower(const Flight& flight, const std::vector<TrackModel>& models,
                             const RobustConfig& config, std::size_t max_hypotheses)
    : models_(&models),
      config_(&config),
      max_hypotheses_(max_hypotheses),
      first_evidence_ns_(flight.plots.front().plot.time_ns),
      first_time_s_(flight.frame_times.front().time_s),
      fit_(config.collect),
      body_sigma_m_(config.collect.extent_sigma_m),
      body_scatter_m2_(kBodyPriorReturns * body_sigma_m_ * body_sigma_m_),
      body_count_(kBodyPriorReturns),
      facing_(facing_side_.Share(body_sigma_m_, config.collect.centroid_offset)) {
  std::vector<const Plot*> path;
  for (std::size_t i = 0; i < flight.plots.size(); ++i) {
    path.push_back(&flight.plots[i].plot);
    AddPlot(flight.plots[i], flight.frame_times[i]);
  }
  for (std::uint32_t m = 0; m < models.size(); ++m) {
    Node node;
    node.model = m;
    for (const Hypothesis& h :
         FilterPath(models[m], path, flight.frame_times, flight.log_birth, config.tracker)) {
      node.h = h;
      node.confirmed = static_cast<std::int32_t>(nodes_.size());
      node.current_score = h.score;
      nodes_.push_back(node);
      node.parent = node.confirmed;
      ++node.plot;
    }
    leaves_.push_back(static_cast<std::int32_t>(nodes_.size()) - 1);
  }
}

void TrackFollower::SetGains(const std::vector<LivePlot>& plots, const FrameTime& at,
                             std::vector<double>* gains) const {
  gains->clear();
  const Node& best = NodeAt(BestLeaf());
  const TrackModel& model = (*models_)[best.model];
  const double score_if_missed = model.ScoreAfterMisses(best.h, at);
  const Prediction p = model.Predict(best.h, model.PredictedScore(best.h, at),
                                     model.MotionOver(at.time_s - best.h.time_s), at);
  for (const LivePlot& seen : plots) {
    const ScoreIncrement increment = model.ScoreIncrementOf(p, seen.plot);
    gains->push_back(increment.is_too_fast ? -std::numeric_limits<double>::infinity()
                                           : p.score + increment.log - score_if_missed);
  }
}

// Sets the current scores of all leaves and the best association of each plot and model. Most
// leaves are worse than others at every plot however near they are: they are not predicted.
void TrackFollower::Associate(const std::vector<LivePlot>& plots,
                              const std::vector<char>& is_allowed, const FrameTime& at) {
  const std::size_t num_models = models_->size();
  std::vector<Association>& associations = scratch_.associations;
  associations.assign(plots.size() * num_models, Association());
  scratch_.predicted.clear();
  FrameBounds bounds;
  for (const LivePlot& seen : plots) bounds.Include(seen.plot);
  for (const std::int32_t leaf : leaves_) {
    Node& node = NodeAt(leaf);
    const TrackModel& model = (*models_)[node.model];
    const Motion motion = model.MotionOver(at.time_s - node.h.time_s);
    node.current_score = model.ScoreAfterMisses(node.h, at);
    const double predicted_score =
        at.sensor == node.h.sensor ? node.current_score : model.PredictedScore(node.h, at);
    const double top = TopOf(predicted_score + model.LogDetectionProbabilityOf(node.h, at),
                             SteadyVariancesOf(node.h.state, motion), bounds);
    bool is_predicted = false;
    for (std::size_t i = 0; i < plots.size(); ++i) {
      if (!is_allowed[i]) continue;
      const Plot& plot = plots[i].plot;
      Association& association = associations[i * num_models + node.model];
      if (top - plot.log_clutter < association.score - kRoundingSlack) continue;
      if (!std::exchange(is_predicted, true)) {
        scratch_.predicted.push_back(
            {leaf, motion, model.Predict(node.h, predicted_score, motion, at)});
      }
      const Prediction& p = scratch_.predicted.back().prediction;
      const double reach_m = kGateSigmas * std::sqrt(p.agile.position_m2 + plot.variance_m2) +
                             0.2 * p.velocity_mps.norm();
      if ((plot.position_m - p.position_m).squaredNorm() > reach_m * reach_m) continue;
      const ScoreIncrement gain = model.ScoreIncrementOf(p, plot);
      if (gain.is_too_fast || p.score + gain.log <= association.score) continue;
      association = {p.score + gain.log, scratch_.predicted.size() - 1, gain};
    }
  }
  if (config_->Uses(Rule::kAgilityChange)) AllowAgilityChanges();
}

// Replaces associations by the best one of the same plot where a change of agility makes that
// likelier: of a target that has flown calmly for long, the calmest model alone would be left.
void TrackFollower::AllowAgilityChanges() {
  const auto is_worse = By(&Association::score);
  const auto num_models = static_cast<std::ptrdiff_t>(models_->size());
  std::vector<Association>& associations = scratch_.associations;
  for (auto first = associations.begin(); first != associations.end(); first += num_models) {
    Association changed = *std::max_element(first, first + num_models, is_worse);
    if (!changed.exists()) continue;
    changed.score += kAgilityChangeLog;
    changed.gain.log += kAgilityChangeLog;
    std::replace_if(
        first, first + num_models,
        [&](const Association& association) { return is_worse(association, changed); }, changed);
  }
}

void TrackFollower::Extend(const std::vector<LivePlot>& plots, const std::vector<char>& is_allowed,
                           const FrameTime& at) {
  Associate(plots, is_allowed, at);
  const std::size_t num_models = models_->size();
  std::vector<std::pair<double, std::int32_t>>& next = scratch_.ranking;
  next.clear();
  for (const std::int32_t leaf : leaves_) {
    const Node& node = NodeAt(leaf);
    if (at.time_s - node.h.time_s <= config_->tracker.max_gap_s) {
      next.emplace_back(-node.current_score, leaf);
    }
  }
  for (std::size_t i = 0; i < plots.size(); ++i) {
    bool is_taken = false;
    for (std::size_t m = 0; m < num_models; ++m) {
      const Association& association = scratch_.associations[i * num_models + m];
      if (!association.exists()) continue;
      const auto& [leaf, motion, prediction] = scratch_.predicted[association.predicted];
      Node node = NodeAt(leaf);
      node.h = (*models_)[node.model].Update(node.h, motion, prediction, plots[i].plot, at,
                                             association.gain);
      node.model = static_cast<std::uint32_t>(m);
      if (!is_taken) {
        AddPlot(plots[i], at);
        is_taken = has_new_plots_ = true;
      }
      node.plot = plots_.size() - 1;
      node.parent = leaf;
      const std::int32_t confirmed = ConfirmedAt(leaf);
      const Hypothesis& last = NodeAt(confirmed).h;
      const bool has_coasted = at.time_s - last.time_s > kMaxCoastS;
      const bool is_confirmed =
          node.h.score - last.score >= (has_coasted ? kReacquisitionGain : kContinuationGain);
      if (is_confirmed && has_coasted) Rejoin(confirmed, &node);
      node.current_score = node.h.score;
      const auto index_of_node = static_cast<std::int32_t>(nodes_.size());
      if (is_confirmed) node.confirmed = index_of_node;
      next.emplace_back(-node.current_score, index_of_node);
      nodes_.push_back(node);
    }
  }
  if (next.empty()) return;  // no hypothesis is left: the track ends
  const auto nth = [&](std::size_t count) {
    return next.begin() + static_cast<std::ptrdiff_t>(std::min(count, next.size()));
  };
  std::nth_element(next.begin(), nth(max_hypotheses_), next.end());
  next.erase(nth(max_hypotheses_), next.end());
  // The best are associated first, as their scores bound the others.
  std::partial_sort(next.begin(), nth(kMaxHypotheses), next.end());
  leaves_.clear();
  for (const auto& [negated_score, leaf] : next) leaves_.push_back(leaf);
  // Of a settled track Settle() forgets.
  if (settled_ == kNoIndex && nodes_.size() >= 2 * num_kept_nodes_) Forget();
}

void TrackFollower::AddPlot(const LivePlot& seen, const FrameTime& at) {
  const std::uint32_t frame = seen.plot.frame;
  if (plots_.empty() || plots_.back().plot.frame != frame) frame_times_.Add(frame, at);
  plots_.push_back(seen);
}

// Replaces the path of a reacquired target from the newest confirmed node to the new one by that of
// RejoinedPlots().
void TrackFollower::Rejoin(std::int32_t confirmed, Node* node) {
  std::vector<std::size_t> plots = {node->plot};
  for (std::int32_t k = node->parent; k != confirmed; k = NodeAt(k).parent) {
    plots.push_back(NodeAt(k).plot);
  }
  std::reverse(plots.begin(), plots.end());
  std::vector<FollowedPlot> followed;
  followed.reserve(plots.size());
  for (const std::size_t plot : plots) {
    followed.push_back({plots_[plot], frame_times_.At(plots_[plot].plot.frame)});
  }
  const std::size_t last = plots.size() - 1;
  std::int32_t parent = confirmed;
  for (const auto& [i, hypothesis] :
       RejoinedPlots((*models_)[node->model], NodeAt(confirmed).h, followed)) {
    Node next = NodeAt(parent);
    next.h = hypothesis;
    next.model = node->model;
    next.parent = parent;
    next.plot = plots[i];
    next.current_score = hypothesis.score;
    parent = static_cast<std::int32_t>(nodes_.size());
    if (i < last) {
      nodes_.push_back(next);
    } else {
      *node = next;
    }
  }
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

std::int32_t TrackFollower::BestLeaf() const {
  return *std::max_element(leaves_.begin(), leaves_.end(), [&](std::int32_t a, std::int32_t b) {
    return NodeAt(a).current_score < NodeAt(b).current_score;
  });
}

bool TrackFollower::IsLost(double time_s) const {
  return time_s - NodeAt(NewestConfirmed()).h.time_s > kMaxCoastS;
}

// Plot of the best hypothesis, unless a new target explains the plots since the confirmed one as
// well.
TimeNs TrackFollower::last_tentative_ns() const {
  const std::int32_t leaf = BestLeaf();
  const Node& best = NodeAt(leaf);
  const Node& confirmed = NodeAt(ConfirmedAt(leaf));
  const bool is_unlikely = best.current_score < confirmed.h.score - kInitiationLog;
  return PlotOf(is_unlikely ? confirmed : best).plot.time_ns;
}

}  // namespace unlidar
