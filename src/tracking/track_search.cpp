#include "tracking/track_search.hpp"

#include "base/maths.hpp"

namespace unlidar {
namespace {

// Hypotheses carried on in addition per plot of the frame: in rain many begin at once.
constexpr std::size_t kMaxHypothesesPerPlot = 5;
constexpr double kUnreachable = std::numeric_limits<double>::infinity();
constexpr std::size_t kMinCompactedSize = 1 << 14;  // of a history: less is not worth the time

// A frame of more plots is worth a ranking and logarithms that bound the scores of its pairs of
// hypothesis and plot. Neither changes the result.
constexpr std::size_t kFewPlots = 8;

bool HasManyPlots(const Scan& scan) { return scan.last - scan.first > kFewPlots; }

}  // namespace

void SetScan(const Plot* plots, std::size_t num_plots, const std::vector<double>& log_births,
             std::size_t first, const FrameTime& at, Scan* scan) {
  scan->first = first;
  scan->plots = plots;
  scan->at = at;
  scan->entries.clear();
  scan->bounds = FrameBounds();
  std::size_t count = 0;
  for (; count < num_plots && plots[count].frame == plots[0].frame; ++count) {
    scan->bounds.Include(plots[count]);
  }
  scan->last = first + count;
  scan->positions_m.Reset(count, [&](std::size_t i) { return plots[i].position_m; });
  for (const std::uint32_t i : scan->positions_m.indices()) {
    scan->entries.push_back({plots[i].log_clutter,
                             std::max(kDeletionLog, log_births[first + i] + kReinitiationLog),
                             first + i});
  }
}

std::vector<Scan> ScansOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                          const ScanSchedule& scan_schedule, std::optional<TimeNs> begin_ns) {
  std::vector<Scan> scans;
  for (std::size_t i = 0; i < plots.size(); i = scans.back().last) {
    scans.emplace_back();
    SetScan(&plots[i], plots.size() - i, log_births, i,
            FrameTimeOf(plots[i], begin_ns.value_or(plots.front().frame_time_ns), scan_schedule),
            &scans.back());
  }
  return scans;
}

TrackSearch::TrackSearch(const std::vector<double>& log_births, const std::vector<Scan>& scans,
                         const std::vector<char>& free, double min_score, const TrackModel& model,
                         const TrackerConfig& config)
    : TrackSearch(log_births, free, model, config) {
  std::size_t full = kMinCompactedSize;
  for (const Scan& scan : scans) {
    Extend(scan);
    AppendEnds(min_score);
    if (history_.size() < full) continue;
    Forget(0);
    full = std::max(kMinCompactedSize, 2 * history_.size());
  }
  active_.clear();
  Forget(0);
  history_.shrink_to_fit();
  marks_ = std::vector<std::int32_t>();
  std::make_heap(ends_.begin(), ends_.end());
}

TrackSearch::TrackSearch(const std::vector<double>& log_births, const std::vector<char>& free,
                         const TrackModel& model, const TrackerConfig& config,
                         double ground_target_m, bool is_gated)
    : log_births_(log_births),
      free_(free),
      model_(model),
      config_(config),
      ground_target_m_(ground_target_m),
      is_gated_(is_gated) {}

void TrackSearch::Extend(const Scan& scan) {
  last_scan_ = history_.size();
  LookAhead(scan);
  PruneHypotheses(scan);
  FindCandidates(scan);
  for (std::size_t i = scan.first; i < scan.last; ++i) {
    if (!free_[i]) continue;
    for (const Candidate& candidate : candidates_[i - scan.first]) {
      if (candidate.increment.is_too_fast) continue;
      const Prediction& p = predictions_[candidate.index];
      const Hypothesis& from = active_[p.hypothesis];
      Hypothesis h =
          model_.Update(from, motions_[p.motion], p, scan.PlotAt(i), scan.at, candidate.increment);
      h.plot = static_cast<std::int32_t>(i);
      h.is_near_ground = scan.PlotAt(i).lowest_m <= ground_target_m_;
      h.parent = from.node;
      h.peak_score = from.peak_score;
      Add(h);
    }
    if (log_births_[i] < kDeletionLog) continue;  // no birth here
    for (const double speed_mps : config_.birth_speeds_mps) {
      Hypothesis h = model_.Birth(scan.PlotAt(i), log_births_[i], scan.at, speed_mps);
      h.plot = static_cast<std::int32_t>(i);
      Add(h);
    }
  }
}

void TrackSearch::Add(Hypothesis hypothesis) {
  hypothesis.node = static_cast<std::int32_t>(history_.size());
  history_.push_back({hypothesis.score, hypothesis.plot, hypothesis.parent, hypothesis.num_plots});
  active_.push_back(hypothesis);
}

// Sets the outlooks of the active hypotheses that are neither too old nor too unlikely by now.
void TrackSearch::LookAhead(const Scan& scan) {
  outlooks_.clear();
  motions_.clear();
  double motion_dt = -1.0;
  for (Hypothesis& from : active_) {
    const double dt = scan.at.time_s - from.time_s;
    if (dt > config_.max_gap_s) continue;
    const double score = model_.PredictedScore(from, scan.at);
    if (score < kDeletionLog) continue;
    if (dt != motion_dt) {
      motions_.push_back(model_.MotionOver(dt));
      motion_dt = dt;
    }
    if (scan.at.sensor != from.sensor && scan.at.sensor != from.other_sensor) {
      model_.SetOtherSensor(scan.at, &from);
    }
    const AxisVariances steady = SteadyVariancesOf(from.state, motions_.back());
    const double top =
        TopOf(score + model_.LogDetectionProbabilityOf(from, scan.at), steady, scan.bounds);
    outlooks_.push_back({score, top, steady, static_cast<std::uint32_t>(&from - active_.data()),
                         static_cast<std::uint32_t>(motions_.size() - 1)});
  }
}

// Drops the active hypotheses without an outlook. In rain most plots are births that lead nowhere,
// so only the best hypotheses are kept, ranked by the highest score that a plot exactly at their
// prediction could reach. A distant birth, whose missed detections cost almost nothing as it would
// hardly ever be seen, does not displace nearby hypotheses.
void TrackSearch::PruneHypotheses(const Scan& scan) {
  ranking_.clear();
  for (std::size_t k = outlooks_.size(); k-- > 0;) ranking_.emplace_back(-outlooks_[k].top, k);
  const auto move_best_to_front = [&](std::size_t count) {
    if (ranking_.size() <= count) return;
    std::nth_element(ranking_.begin(), ranking_.begin() + static_cast<std::ptrdiff_t>(count),
                     ranking_.end());
  };
  const std::size_t most = static_cast<std::size_t>(config_.max_hypotheses) +
                           kMaxHypothesesPerPlot * (scan.last - scan.first);
  move_best_to_front(most);
  ranking_.resize(std::min(ranking_.size(), most));
  // The most promising are evaluated first, as their scores bound the others; the order does not
  // change the result. Among few plots the latest, which come first, are promising enough.
  constexpr std::size_t kNumRankedFirst = 64;
  if (HasManyPlots(scan)) move_best_to_front(kNumRankedFirst);
  is_kept_.assign(outlooks_.size(), 0);
  for (const auto& [negated_top, k] : ranking_) is_kept_[k] = 1;
  std::uint32_t num_kept = 0;
  for (std::size_t k = 0; k < outlooks_.size(); ++k) {
    if (!is_kept_[k]) continue;
    const std::uint32_t from = std::exchange(outlooks_[k].hypothesis, num_kept);
    if (from != num_kept) active_[num_kept] = active_[from];
    ++num_kept;
  }
  active_.resize(num_kept);
}

// Finds the best continuations to each free plot whose score is not much below that of a birth
// there.
void TrackSearch::FindCandidates(const Scan& scan) {
  while (candidates_.size() < scan.last - scan.first) {
    candidates_.emplace_back();
    candidates_.back().reserve(static_cast<std::size_t>(config_.hypotheses_per_plot) + 1);
  }
  for (std::vector<Candidate>& candidates : candidates_) candidates.clear();
  thresholds_.clear();
  for (const Scan::Entry& entry : scan.entries) {
    thresholds_.push_back(free_[entry.plot] ? entry.score_threshold : kUnreachable);
  }
  least_bounds_.resize(scan.positions_m.nodes().size());
  for (std::size_t node = least_bounds_.size(); node-- > 0;) {  // children before their parent
    SetLeastBound(scan, static_cast<std::uint32_t>(node));
  }
  predictions_.clear();
  for (const auto& [negated_top, k] : ranking_) {
    const bool reaches_no_plot = -negated_top < least_bounds_.front() - kRoundingSlack;
    if (!reaches_no_plot) Continue(outlooks_[k], scan);
  }
}

// Returns false if nothing changed.
bool TrackSearch::SetLeastBound(const Scan& scan, std::uint32_t id) {
  const PointTree<double>::Node& node = scan.positions_m.nodes()[id];
  double least = kUnreachable;
  if (node.IsLeaf()) {
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      least = std::min(least, thresholds_[i] + scan.entries[i].log_clutter);
    }
  } else {
    least = std::min(least_bounds_[node.left], least_bounds_[node.right]);
  }
  return std::exchange(least_bounds_[id], least) != least;
}

void TrackSearch::Continue(const Outlook& outlook, const Scan& scan) {
  const Hypothesis& from = active_[outlook.hypothesis];
  const Motion& motion = motions_[outlook.motion];
  const Eigen::Vector3d position_m = PositionAfter(from.state, motion);
  const AxisVariances agile = AgileVariancesOf(outlook.steady, motion);
  ScoreBound bound =
      model_.BoundOf(from.state, motion, outlook.steady, agile, scan.bounds, outlook.top);
  if (is_gated_) bound.gate_log = 0.5 * Square(config_.gate_sigmas);
  if (HasManyPlots(scan)) {
    bound.agile_top = model_.AgileTopOf(
        outlook.score + model_.LogDetectionProbabilityOf(from, scan.at), agile, scan.bounds);
  }
  const std::vector<PointTree<double>::Node>& nodes = scan.positions_m.nodes();
  bool is_predicted = false;
  for (std::uint32_t id = 0; id < nodes.size();) {
    const PointTree<double>::Node& node = nodes[id];
    const Eigen::Vector3d nearest_m = position_m.cwiseMax(node.low_m).cwiseMin(node.high_m);
    const double most = bound.At((nearest_m - position_m).squaredNorm());
    if (most < least_bounds_[id] - kRoundingSlack) {
      id = node.next;
      continue;
    }
    if (node.IsLeaf()) {
      if (!std::exchange(is_predicted, true)) {
        predictions_.push_back(model_.Predict(from, outlook.score, motion, scan.at));
        predictions_.back().hypothesis = outlook.hypothesis;
        predictions_.back().motion = outlook.motion;
      }
      if (ContinueToLeaf(scan, node, bound)) {
        for (std::uint32_t raised = id; SetLeastBound(scan, raised) && raised > 0;) {
          raised = nodes[raised].parent;
        }
      }
    }
    ++id;
  }
}

// Continues the last prediction. Returns true if the threshold of a plot was raised.
bool TrackSearch::ContinueToLeaf(const Scan& scan, const PointTree<double>::Node& leaf,
                                 const ScoreBound& bound) {
  const Prediction& p = predictions_.back();
  const Hypothesis& from = active_[p.hypothesis];
  bool is_raised = false;
  for (std::uint32_t i = leaf.begin; i < leaf.end; ++i) {
    const Scan::Entry& entry = scan.entries[i];
    const double distance2_m2 = (scan.positions_m.points_m()[i] - p.position_m).squaredNorm();
    if (bound.At(distance2_m2) - entry.log_clutter < thresholds_[i] - kRoundingSlack) continue;
    const Plot& plot = scan.PlotAt(entry.plot);
    const ScoreIncrement increment = model_.ScoreIncrementOf(p, plot);
    if (is_gated_ && (increment.is_too_fast || increment.is_beyond_gate)) continue;
    const double score = p.score + increment.log;
    if (score < thresholds_[i]) continue;
    // From near the ground to a plot above it, a new target is likelier.
    if (from.is_near_ground && plot.lowest_m > ground_target_m_ &&
        score - from.score < log_births_[entry.plot]) {
      continue;
    }
    std::vector<Candidate>& best = candidates_[entry.plot - scan.first];
    InsertCandidate({score, increment, p.hypothesis, predictions_.size() - 1}, &best);
    if (best.size() < static_cast<std::size_t>(config_.hypotheses_per_plot)) continue;
    thresholds_[i] = best.back().score;
    is_raised = true;
  }
  return is_raised;
}

void TrackSearch::InsertCandidate(const Candidate& candidate, std::vector<Candidate>* best) const {
  const auto at = std::upper_bound(
      best->begin(), best->end(), candidate, [](const Candidate& a, const Candidate& b) {
        return a.score > b.score || (a.score == b.score && a.hypothesis < b.hypothesis);
      });
  best->insert(at, candidate);
  if (best->size() > static_cast<std::size_t>(config_.hypotheses_per_plot)) best->pop_back();
}

}  // namespace unlidar
