#include "track_search.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>

namespace unlidar {

TrackSearch::TrackSearch(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                         const std::vector<char>& free, const TrackModel& model,
                         const TrackerConfig& config)
    : plots_(plots), log_births_(log_births), free_(free), model_(model), config_(config) {
  for (std::size_t first = 0; first < plots_.size();) {
    std::size_t last = first;
    while (last < plots_.size() && plots_[last].time_ns == plots_[first].time_ns) ++last;
    Extend(first, last);
    first = last;
  }
}

Path TrackSearch::Best() const {
  Path path;
  std::int32_t at = kNone;
  std::vector<char> is_blocked(history_.size(), 0);
  const double least_hits = config_.min_fragment_plots - 1.0;
  for (std::size_t h = 0; h < history_.size(); ++h) {
    const Hypothesis& hypothesis = history_[h];
    is_blocked[h] =
        !free_[static_cast<std::size_t>(hypothesis.plot)] ||
        (hypothesis.parent != kNone && is_blocked[static_cast<std::size_t>(hypothesis.parent)]);
    if (!is_blocked[h] && hypothesis.score > path.score && hypothesis.hits >= least_hits) {
      path.score = hypothesis.score;
      at = static_cast<std::int32_t>(h);
    }
  }
  for (; at != kNone; at = history_[static_cast<std::size_t>(at)].parent) {
    path.plots.push_back(static_cast<std::uint32_t>(history_[static_cast<std::size_t>(at)].plot));
  }
  std::reverse(path.plots.begin(), path.plots.end());
  return path;
}

void TrackSearch::Extend(std::size_t first, std::size_t last) {
  const double time_s = TimeOf(plots_, first);
  Predict(time_s);
  KeepBest(first, last);
  FindCandidates(first, last);
  for (std::size_t i = first; i < last; ++i) {
    if (!free_[i]) continue;
    std::vector<Candidate>& candidates = candidates_[i - first];
    const auto kept =
        std::min(candidates.size(), static_cast<std::size_t>(config_.hypotheses_per_plot));
    std::partial_sort(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(kept),
                      candidates.end(), [](const Candidate& a, const Candidate& b) {
                        return a.score > b.score || (a.score == b.score && a.index < b.index);
                      });
    for (std::size_t c = 0; c < kept; ++c) {
      const Prediction& p = predictions_[candidates[c].index];
      const Hypothesis& from = history_[static_cast<std::size_t>(p.history)];
      Hypothesis h = model_.Update(from, model_.MotionOver(time_s - from.time_s), p, plots_[i],
                                   time_s, candidates[c].gain);
      if (h.state.mean.col(1).norm() > config_.max_speed_mps) continue;
      h.plot = static_cast<std::int32_t>(i);
      h.parent = p.history;
      Add(h);
    }
    for (const double speed_mps : config_.birth_speeds_mps) {
      Hypothesis h = model_.Birth(plots_[i], log_births_[i], time_s, speed_mps);
      h.plot = static_cast<std::int32_t>(i);
      Add(h);
    }
  }
}

void TrackSearch::Add(const Hypothesis& hypothesis) {
  active_.push_back(static_cast<std::int32_t>(history_.size()));
  history_.push_back(hypothesis);
}

// Carries all hypotheses on to a time. Drops what is too old or too unlikely.
void TrackSearch::Predict(double time_s) {
  predictions_.clear();
  double motion_dt = -1.0;
  Motion motion;
  for (const std::int32_t index : active_) {
    const Hypothesis& from = history_[static_cast<std::size_t>(index)];
    const double dt = time_s - from.time_s;
    if (dt > config_.max_gap_s) continue;
    const double score_if_visible = model_.ScoreIfVisible(from, time_s);
    if (model_.Score(from, time_s, score_if_visible) < config_.give_up_log) continue;
    if (dt != motion_dt) {
      motion = model_.MotionOver(dt);
      motion_dt = dt;
    }
    predictions_.push_back(model_.Predict(from, time_s, score_if_visible, motion));
    predictions_.back().history = index;
  }
}

// In rain most plots are births that lead nowhere: only the best hypotheses are carried on, by what
// a plot just where they expect it could make of them. A birth far away, whose misses cost nothing
// because it would hardly ever be seen, does not crowd out what is near.
void TrackSearch::KeepBest(std::size_t first, std::size_t last) {
  variances_ = {plots_[first].variance_m2, plots_[first].variance_m2};
  for (std::size_t i = first; i < last; ++i) {
    variances_.least_m2 = std::min(variances_.least_m2, plots_[i].variance_m2);
    variances_.largest_m2 = std::max(variances_.largest_m2, plots_[i].variance_m2);
  }
  const std::size_t most =
      static_cast<std::size_t>(config_.max_hypotheses) +
      static_cast<std::size_t>(config_.max_hypotheses_per_plot) * (last - first);
  if (predictions_.size() > most) {
    std::vector<std::pair<double, std::size_t>> promises;
    for (std::size_t k = 0; k < predictions_.size(); ++k) {
      promises.emplace_back(-model_.BoundOf(predictions_[k], variances_).steady_top, k);
    }
    std::nth_element(promises.begin(), promises.begin() + static_cast<std::ptrdiff_t>(most),
                     promises.end());
    promises.resize(most);
    std::sort(promises.begin(), promises.end(),
              [](const auto& a, const auto& b) { return a.second < b.second; });
    for (std::size_t k = 0; k < most; ++k) predictions_[k] = predictions_[promises[k].second];
    predictions_.resize(most);
  }
  active_.clear();
  for (const Prediction& p : predictions_) active_.push_back(p.history);
}

// The plots of [first, last) that continue a hypothesis better than a new one would begin there.
void TrackSearch::FindCandidates(std::size_t first, std::size_t last) {
  candidates_.resize(std::max(candidates_.size(), last - first));
  for (std::vector<Candidate>& candidates : candidates_) candidates.clear();
  // What each plot asks of a prediction.
  std::vector<double> needs;
  for (std::size_t i = first; i < last; ++i) {
    needs.push_back(LeastScore(i) - model_.PlotBound(plots_[i]));
  }
  const double least_need = *std::min_element(needs.begin(), needs.end());
  std::vector<std::size_t> by_x(last - first);
  std::iota(by_x.begin(), by_x.end(), first);
  std::sort(by_x.begin(), by_x.end(), [&](std::size_t a, std::size_t b) {
    return plots_[a].position_m.x() < plots_[b].position_m.x();
  });
  for (std::size_t k = 0; k < predictions_.size(); ++k) {
    const Prediction& p = predictions_[k];
    const ScoreBound bound = model_.BoundOf(p, variances_);
    const double reach_m2 = bound.ReachM2(least_need);
    if (reach_m2 < 0.0) continue;
    const double reach_m = std::sqrt(reach_m2);
    const auto begin =
        std::lower_bound(by_x.begin(), by_x.end(), p.position_m.x() - reach_m,
                         [&](std::size_t i, double x) { return plots_[i].position_m.x() < x; });
    for (auto at = begin; at != by_x.end(); ++at) {
      const std::size_t i = *at;
      if (plots_[i].position_m.x() > p.position_m.x() + reach_m) break;
      if (!free_[i]) continue;
      const double distance2_m2 = (plots_[i].position_m - p.position_m).squaredNorm();
      if (bound.At(distance2_m2) < needs[i - first]) continue;
      const Gain gain = model_.GainOf(p, plots_[i]);
      if (p.score + gain.log < LeastScore(i)) continue;
      candidates_[i - first].push_back({p.score + gain.log, gain, k});
    }
  }
}

double TrackSearch::LeastScore(std::size_t plot) const {
  return std::max(config_.give_up_log, log_births_[plot] + config_.rebirth_log);
}

}  // namespace unlidar
