#include "tracking/track_search.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace unlidar {
namespace {

// Bounds are exact but for rounding.
constexpr double kBoundSlack = 1e-9;

}  // namespace

void SetSlice(const std::vector<Plot>& plots, const std::vector<double>& log_births,
              std::size_t first, const Moment& at, const TrackerConfig& config, Slice* slice) {
  slice->first = slice->last = first;
  slice->at = at;
  slice->places.clear();
  FrameBounds& bounds = slice->bounds;
  bounds = FrameBounds();
  bounds.least_variance_m2 = plots[first].variance_m2;
  bounds.streak_s = plots[first].streak_s;
  std::size_t& last = slice->last;
  for (; last < plots.size() && plots[last].frame == plots[first].frame; ++last) {
    const Plot& plot = plots[last];
    bounds.least_variance_m2 = std::min(bounds.least_variance_m2, plot.variance_m2);
    bounds.largest_variance_m2 = std::max(bounds.largest_variance_m2, plot.variance_m2);
    bounds.half_span_s =
        std::max(bounds.half_span_s,
                 static_cast<double>(std::abs(plot.time_ns - plot.frame_time_ns)) * kSecondsPerNs);
    slice->places.push_back({plot.position_m, plot.log_clutter,
                             std::max(config.give_up_log, log_births[last] + config.rebirth_log),
                             last});
  }
  std::sort(slice->places.begin(), slice->places.end(),
            [](const Slice::Place& a, const Slice::Place& b) {
              return a.position_m.x() < b.position_m.x();
            });
}

std::vector<Slice> SlicesOf(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                            const Watch& watch, const TrackerConfig& config) {
  std::vector<Slice> slices;
  for (std::size_t i = 0; i < plots.size(); i = slices.back().last) {
    slices.emplace_back();
    SetSlice(plots, log_births, i, MomentOf(plots[i], plots.front(), watch), config,
             &slices.back());
  }
  return slices;
}

TrackSearch::TrackSearch(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                         const std::vector<Slice>& slices, const std::vector<char>& free,
                         const TrackModel& model, const TrackerConfig& config)
    : TrackSearch(plots, log_births, free, model, config) {
  // Room for the births and as many that go on: rarely are there more, which then have to move.
  history_.reserve(plots.size() * 2 * config.birth_speeds_mps.size());
  for (const Slice& slice : slices) Extend(slice);
  const auto least_plots = static_cast<std::uint32_t>(config_.min_fragment_plots);
  for (std::size_t h = 0; h < history_.size(); ++h) {
    if (history_[h].score <= 0.0 || history_[h].num_plots < least_plots) continue;
    ends_.push_back({history_[h].score, static_cast<std::int32_t>(h)});
  }
  std::make_heap(ends_.begin(), ends_.end());
}

TrackSearch::TrackSearch(const std::vector<Plot>& plots, const std::vector<double>& log_births,
                         const std::vector<char>& free, const TrackModel& model,
                         const TrackerConfig& config)
    : plots_(plots), log_births_(log_births), free_(free), model_(model), config_(config) {}

Path TrackSearch::Best() {
  for (; !ends_.empty(); ends_.pop_back()) {
    Path path;
    path.score = ends_.front().score;
    bool is_free = true;
    for (std::int32_t at = ends_.front().hypothesis; at != kNoIndex && is_free;) {
      const Hypothesis& hypothesis = history_[static_cast<std::size_t>(at)];
      path.plots.push_back(static_cast<std::uint32_t>(hypothesis.plot));
      is_free = free_[path.plots.back()] != 0;
      at = hypothesis.parent;
    }
    if (is_free) {
      std::reverse(path.plots.begin(), path.plots.end());
      return path;
    }
    std::pop_heap(ends_.begin(), ends_.end());
  }
  return {};
}

void TrackSearch::SetPathTo(std::int32_t hypothesis, Path* path) const {
  path->plots.clear();
  path->score = history_[static_cast<std::size_t>(hypothesis)].score;
  for (std::int32_t at = hypothesis; at != kNoIndex;) {
    const Hypothesis& h = history_[static_cast<std::size_t>(at)];
    path->plots.push_back(static_cast<std::uint32_t>(h.plot));
    at = h.parent;
  }
  std::reverse(path->plots.begin(), path->plots.end());
}

void TrackSearch::AppendPathsToLastSlice(double least, Queue<Path>* paths) const {
  // Those of one plot come one after the other.
  for (std::size_t first = last_slice_; first < history_.size();) {
    std::size_t best = first;
    std::size_t h = first;
    for (; h < history_.size() && history_[h].plot == history_[first].plot; ++h) {
      if (history_[h].score > history_[best].score) best = h;
    }
    if (history_[best].score >= least) {
      SetPathTo(static_cast<std::int32_t>(best), &paths->Append());
    }
    first = h;
  }
}

void TrackSearch::AppendWays(const Moment& end, double least, std::vector<Way>* ways) const {
  for (const Hypothesis& last : history_) {
    if (last.score < least) continue;
    Way way;
    way.score = model_.ScoreUnseen(last, end);
    if (way.score < least) continue;
    for (const Hypothesis* h = &last; h != nullptr;
         h = h->parent == kNoIndex ? nullptr : &history_[static_cast<std::size_t>(h->parent)]) {
      way.steps.push_back({static_cast<std::uint32_t>(h->plot), h->time_s, h->state});
    }
    std::reverse(way.steps.begin(), way.steps.end());
    ways->push_back(std::move(way));
  }
}

void TrackSearch::DropTaken() {
  std::vector<std::int32_t>& is_taken = marks_;
  is_taken.resize(history_.size());
  for (std::size_t h = 0; h < history_.size(); ++h) {
    const std::int32_t parent = history_[h].parent;
    is_taken[h] = !free_[static_cast<std::size_t>(history_[h].plot)] ||
                          (parent != kNoIndex && is_taken[static_cast<std::size_t>(parent)] != 0)
                      ? 1
                      : 0;
  }
  active_.erase(
      std::remove_if(active_.begin(), active_.end(),
                     [&](std::int32_t h) { return is_taken[static_cast<std::size_t>(h)] != 0; }),
      active_.end());
}

void TrackSearch::Forget(std::size_t num_plots) {
  const auto is_kept_plot = [&](std::int32_t h) {
    return static_cast<std::size_t>(history_[static_cast<std::size_t>(h)].plot) >= num_plots;
  };
  active_.erase(std::remove_if(active_.begin(), active_.end(),
                               [&](std::int32_t h) { return !is_kept_plot(h); }),
                active_.end());
  std::vector<std::int32_t>& moved = marks_;
  moved.reserve(history_.capacity());
  moved.assign(history_.size(), kNoIndex);
  constexpr std::int32_t kWanted = 0;
  for (const std::int32_t leaf : active_) {
    for (std::int32_t h = leaf; h != kNoIndex && is_kept_plot(h);) {
      std::int32_t& mark = moved[static_cast<std::size_t>(h)];
      if (mark == kWanted) break;
      mark = kWanted;
      h = history_[static_cast<std::size_t>(h)].parent;
    }
  }
  std::size_t kept = 0;
  for (std::size_t h = 0; h < history_.size(); ++h) {
    if (moved[h] != kWanted) continue;
    Hypothesis hypothesis = history_[h];
    hypothesis.plot -= static_cast<std::int32_t>(num_plots);
    if (hypothesis.parent != kNoIndex) {
      hypothesis.parent = moved[static_cast<std::size_t>(hypothesis.parent)];
    }
    moved[h] = static_cast<std::int32_t>(kept);
    history_[kept++] = hypothesis;
  }
  history_.resize(kept);
  last_slice_ = kept;
  for (std::int32_t& h : active_) h = moved[static_cast<std::size_t>(h)];
}

void TrackSearch::Extend(const Slice& slice) {
  last_slice_ = history_.size();
  Predict(slice.at);
  KeepBest(slice);
  FindCandidates(slice);
  for (std::size_t i = slice.first; i < slice.last; ++i) {
    if (!free_[i]) continue;
    for (const Candidate& candidate : candidates_[i - slice.first]) {
      const Prediction& p = predictions_[candidate.index];
      const Hypothesis& from = history_[static_cast<std::size_t>(p.history)];
      Hypothesis h =
          model_.Update(from, motions_[p.motion], p, plots_[i], slice.at, candidate.gain);
      if (h.state.mean.col(1).norm() > config_.max_speed_mps) continue;
      h.plot = static_cast<std::int32_t>(i);
      h.parent = p.history;
      Add(h);
    }
    if (log_births_[i] < config_.give_up_log) continue;  // where nothing begins
    for (const double speed_mps : config_.birth_speeds_mps) {
      Hypothesis h = model_.Birth(plots_[i], log_births_[i], slice.at, speed_mps);
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
void TrackSearch::Predict(const Moment& at) {
  predictions_.clear();
  motions_.clear();
  double motion_dt = -1.0;
  for (const std::int32_t index : active_) {
    const Hypothesis& from = history_[static_cast<std::size_t>(index)];
    const double dt = at.time_s - from.time_s;
    if (dt > config_.max_gap_s) continue;
    const double score = model_.ScoreBefore(from, at);
    if (score < config_.give_up_log) continue;
    if (dt != motion_dt) {
      motions_.push_back(model_.MotionOver(dt));
      motion_dt = dt;
    }
    predictions_.push_back(model_.Predict(from, score, motions_.back(), at));
    predictions_.back().history = index;
    predictions_.back().motion = static_cast<std::uint32_t>(motions_.size() - 1);
  }
}

// In rain most plots are births that lead nowhere: only the best hypotheses are carried on, by what
// a plot just where they expect it could make of them. A birth far away, whose misses cost nothing
// because it would hardly ever be seen, does not crowd out what is near.
void TrackSearch::KeepBest(const Slice& slice) {
  bounds_.clear();
  promises_.clear();
  for (const Prediction& p : predictions_) {
    bounds_.push_back(model_.BoundOf(p, slice.bounds));
    promises_.emplace_back(-bounds_.back().steady_top, promises_.size());
  }
  const auto move_best_to_front = [&](std::size_t count) {
    if (promises_.size() <= count) return;
    std::nth_element(promises_.begin(), promises_.begin() + static_cast<std::ptrdiff_t>(count),
                     promises_.end());
  };
  const std::size_t most =
      static_cast<std::size_t>(config_.max_hypotheses) +
      static_cast<std::size_t>(config_.max_hypotheses_per_plot) * (slice.last - slice.first);
  move_best_to_front(most);
  promises_.resize(std::min(promises_.size(), most));
  // What the most promising make of a plot bounds the others from the start; the order changes no
  // result.
  constexpr std::size_t kPromising = 64;
  move_best_to_front(kPromising);
  is_kept_.assign(predictions_.size(), 0);
  for (const auto& [promise, k] : promises_) is_kept_[k] = 1;
  active_.clear();
  for (std::size_t k = 0; k < predictions_.size(); ++k) {
    if (is_kept_[k]) active_.push_back(predictions_[k].history);
  }
}

// The best ways to go on to each free plot, if they are not much worse than to begin there.
void TrackSearch::FindCandidates(const Slice& slice) {
  while (candidates_.size() < slice.last - slice.first) {
    candidates_.emplace_back();
    candidates_.back().reserve(static_cast<std::size_t>(config_.hypotheses_per_plot) + 1);
  }
  for (std::vector<Candidate>& candidates : candidates_) candidates.clear();
  places_.clear();
  for (const Slice::Place& place : slice.places) {
    if (free_[place.plot]) places_.push_back(place);
  }
  if (places_.empty()) return;
  double least_need = -std::numeric_limits<double>::infinity();
  bool is_stale = true;  // the place of the least need needs more by now
  for (const auto& [promise, k] : promises_) {
    if (is_stale) {
      least_need = std::numeric_limits<double>::infinity();
      for (const Slice::Place& place : places_) {
        least_need = std::min(least_need, place.least_score + place.log_clutter);
      }
      is_stale = false;
    }
    const Prediction& p = predictions_[k];
    const ScoreBound& bound = bounds_[k];
    const double reach_m = bound.ReachM(least_need - kBoundSlack);
    if (reach_m < 0.0) continue;
    auto place =
        std::lower_bound(places_.begin(), places_.end(), p.position_m.x() - reach_m,
                         [](const Slice::Place& at, double x) { return at.position_m.x() < x; });
    for (; place != places_.end() && place->position_m.x() <= p.position_m.x() + reach_m; ++place) {
      const double distance2_m2 = (place->position_m - p.position_m).squaredNorm();
      if (bound.At(distance2_m2) - place->log_clutter < place->least_score - kBoundSlack) continue;
      const Gain gain = model_.GainOf(p, plots_[place->plot]);
      const double score = p.score + gain.log;
      if (score < place->least_score) continue;
      std::vector<Candidate>& best = candidates_[place->plot - slice.first];
      Keep({score, gain, k}, &best);
      if (best.size() < static_cast<std::size_t>(config_.hypotheses_per_plot)) continue;
      is_stale = is_stale || place->least_score + place->log_clutter <= least_need;
      place->least_score = best.back().score;
    }
  }
}

void TrackSearch::Keep(const Candidate& candidate, std::vector<Candidate>* best) const {
  const auto at = std::upper_bound(
      best->begin(), best->end(), candidate, [](const Candidate& a, const Candidate& b) {
        return a.score > b.score || (a.score == b.score && a.index < b.index);
      });
  best->insert(at, candidate);
  if (best->size() > static_cast<std::size_t>(config_.hypotheses_per_plot)) best->pop_back();
}

}  // namespace unlidar
