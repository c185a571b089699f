#include "track_search.hpp"

#include <algorithm>
#include <cstddef>
#include <functional>

namespace unlidar {

TrackSearch::TrackSearch(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                         const std::vector<char>& free, const TrackModel& model,
                         const TrackerConfig& config)
    : plots_(plots), log_births_(log_births), free_(free), model_(model), config_(config) {
  for (std::size_t first = 0; first < plots_.size();) {
    std::size_t last = first;
    while (last < plots_.size() && plots_[last].time_ns == plots_[first].time_ns) ++last;
    Predict(TimeOf(plots_, first));
    const std::size_t size_before = history_.size();
    for (std::size_t i = first; i < last; ++i) {
      if (free_[i]) Extend(static_cast<std::int32_t>(i));
    }
    for (std::size_t h = size_before; h < history_.size(); ++h) {
      active_.push_back(static_cast<std::int32_t>(h));
    }
    first = last;
  }
}

Path TrackSearch::Best() const {
  Path path;
  std::int32_t at = kNone;
  std::vector<char> is_blocked(history_.size(), 0);
  for (std::size_t h = 0; h < history_.size(); ++h) {
    const Hypothesis& hypothesis = history_[h];
    is_blocked[h] =
        !free_[static_cast<std::size_t>(hypothesis.plot)] ||
        (hypothesis.parent != kNone && is_blocked[static_cast<std::size_t>(hypothesis.parent)]);
    if (!is_blocked[h] && hypothesis.score > path.score) {
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

void TrackSearch::Predict(double time_s) {
  predictions_.clear();
  std::size_t kept = 0;
  double motion_dt = -1.0;
  Motion motion;
  for (const std::int32_t h : active_) {
    const Hypothesis& from = history_[static_cast<std::size_t>(h)];
    const double dt = time_s - from.time_s;
    if (dt > config_.max_gap_s || model_.ScoreAt(from, time_s) < config_.give_up_log) continue;
    active_[kept++] = h;
  }
  active_.resize(kept);
  KeepBest(time_s);
  for (const std::int32_t h : active_) {
    const Hypothesis& from = history_[static_cast<std::size_t>(h)];
    const double dt = time_s - from.time_s;
    if (dt != motion_dt) {
      motion = model_.MotionOver(dt);
      motion_dt = dt;
    }
    predictions_.push_back(model_.Predict(from, time_s, motion));
    predictions_.back().history = h;
  }
}

// In rain most plots are births that lead nowhere: only the best hypotheses are carried on.
void TrackSearch::KeepBest(double time_s) {
  const auto most = static_cast<std::size_t>(config_.max_hypotheses);
  if (active_.size() <= most) return;
  std::vector<double> scores;
  for (const std::int32_t h : active_) {
    scores.push_back(model_.ScoreAt(history_[static_cast<std::size_t>(h)], time_s));
  }
  std::vector<double> sorted = scores;
  const auto last = sorted.begin() + static_cast<std::ptrdiff_t>(most - 1);
  std::nth_element(sorted.begin(), last, sorted.end(), std::greater<>());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < active_.size() && kept < most; ++i) {
    if (scores[i] >= *last) active_[kept++] = active_[i];
  }
  active_.resize(kept);
}

void TrackSearch::Extend(std::int32_t index) {
  const Plot& plot = plots_[static_cast<std::size_t>(index)];
  const double time_s = TimeOf(plots_, static_cast<std::size_t>(index));
  candidates_.clear();
  for (std::size_t k = 0; k < predictions_.size(); ++k) {
    const Prediction& p = predictions_[k];
    // Beyond ten standard deviations no gain is left: spares the logarithm for most pairs.
    const double reach2 = 100.0 * (p.agile_covariance(0, 0) + 1.0);
    if ((plot.position_m - p.state.mean.col(0)).squaredNorm() > reach2) continue;
    const Gain gain = model_.GainOf(p, plot);
    if (p.score + gain.log > config_.give_up_log) {
      candidates_.push_back({p.score + gain.log, gain, k});
    }
  }
  const auto kept =
      std::min(candidates_.size(), static_cast<std::size_t>(config_.hypotheses_per_plot));
  std::partial_sort(candidates_.begin(), candidates_.begin() + static_cast<std::ptrdiff_t>(kept),
                    candidates_.end(), [](const Candidate& a, const Candidate& b) {
                      return a.score > b.score || (a.score == b.score && a.index < b.index);
                    });
  for (std::size_t c = 0; c < kept; ++c) {
    const Prediction& p = predictions_[candidates_[c].index];
    Hypothesis h = model_.Update(p, plot, time_s, candidates_[c].gain);
    if (h.state.mean.col(1).norm() > config_.max_speed_mps) continue;
    h.plot = index;
    h.parent = p.history;
    history_.push_back(h);
  }
  for (const double speed_mps : config_.birth_speeds_mps) {
    history_.push_back(model_.Birth(plot, log_births_[static_cast<std::size_t>(index)], time_s, speed_mps));
    history_.back().plot = index;
  }
}

}  // namespace unlidar
