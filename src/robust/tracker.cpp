#include "unlidar/robust/tracker.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>

namespace unlidar {
namespace {

constexpr std::int32_t kNone = -1;

// Position, velocity, acceleration; the covariance is the same on every axis.
struct State {
  Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();  // column 0 position, 1 velocity, 2 acceleration
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

// Singer's model: acceleration decays with time constant tau and standard deviation sigma.
struct Motion {
  Eigen::Matrix3d transition = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();
};

Motion SingerMotion(double dt, double tau, double sigma) {
  const double a = 1.0 / tau;
  const double x = a * dt;
  const double e = std::exp(-x);
  Motion m;
  m.transition << 1, dt, (x - 1 + e) / (a * a), 0, 1, (1 - e) / a, 0, 0, e;
  if (x < 0.05) {
    // The exact terms below cancel; to first order the acceleration is a random walk.
    m.noise << std::pow(dt, 5) / 20, std::pow(dt, 4) / 8, std::pow(dt, 3) / 6, std::pow(dt, 4) / 8,
        std::pow(dt, 3) / 3, dt * dt / 2, std::pow(dt, 3) / 6, dt * dt / 2, dt;
    m.noise *= 2.0 * a * sigma * sigma;
    return m;
  }
  // Singer (1970), eq. (12): exact discretisation.
  const double e2 = e * e;
  const double q11 = (1 - e2 + 2 * x + 2 * x * x * x / 3 - 2 * x * x - 4 * x * e) / std::pow(a, 4);
  const double q12 = (e2 + 1 - 2 * e + 2 * x * e - 2 * x + x * x) / std::pow(a, 3);
  const double q13 = (1 - e2 - 2 * x * e) / (a * a);
  const double q22 = (4 * e - 3 - e2 + 2 * x) / (a * a);
  const double q23 = (e2 + 1 - 2 * e) / a;
  m.noise << q11, q12, q13, q12, q22, q23, q13, q23, 1 - e2;
  m.noise *= sigma * sigma;
  return m;
}

struct Hypothesis {
  double score = 0.0;
  double time_s = 0.0;
  double hits = 0.0;             // plots after the first
  double exposure_per_m2 = 0.0;  // sum over the slices in which it could be seen of 1 / range^2
  State state;
  std::int32_t plot = 0;
  std::int32_t parent = kNone;  // index into the history
};

// A hypothesis carried to the time of the plots at hand.
struct Prediction {
  std::int32_t history = kNone;
  double score = 0.0;  // misses on the way counted
  double log_hit = 0.0;
  double hits = 0.0;
  double exposure_per_m2 = 0.0;
  double speed_mps = 0.0;
  State state;
  Eigen::Matrix3d agile_covariance = Eigen::Matrix3d::Zero();  // had it manoeuvred on the way
};

// What a plot adds to the score of a prediction.
struct Gain {
  double log = 0.0;
  bool is_agile = false;  // a manoeuvre explains it better
};

// Variance of a plot per axis for a target at `speed_mps` whose return times within the frame are
// not known: a streak along its motion, a third of whose variance falls on each axis.
double StreakVarianceM2(const Plot& plot, double speed_mps, double period_s) {
  const double along_m = speed_mps * period_s;
  return plot.variance_m2 +
         along_m * along_m / 12.0 / static_cast<double>(plot.returns.size()) / 3.0;
}

// The likelihoods of the model: how a target of one agility moves, is missed and is seen.
class Model {
 public:
  Model(double sigma_a_mps2, double period_s, const TrackerConfig& config)
      : sigma_(sigma_a_mps2), period_s_(period_s), config_(config) {}

  Hypothesis Birth(const Plot& plot, double time_s, double speed_mps) const {
    Hypothesis birth;
    birth.time_s = time_s;
    birth.state.mean.col(0) = plot.position_m;
    birth.state.covariance.diagonal() << plot.variance_m2, speed_mps * speed_mps, sigma_ * sigma_;
    return birth;
  }

  // Score of a hypothesis that was not seen until `time_s`. A long miss is either bad luck or a
  // shadow, whichever is likelier.
  double ScoreAt(const Hypothesis& from, double time_s) const {
    const double dt = time_s - from.time_s;
    const double missed = std::max(0.0, std::round(dt / period_s_) - 1.0);
    return from.score + std::max(LogMiss(from, missed * SliceExposure(from.state)),
                                 config_.shadow_log + config_.shadow_log_per_s * dt);
  }

  Prediction Predict(const Hypothesis& from, double time_s, const Motion& motion) const {
    const double slice = SliceExposure(from.state);
    Prediction p;
    p.score = ScoreAt(from, time_s);
    p.log_hit = std::log(std::max(-std::expm1(LogMiss(from, slice)), 1e-6));
    p.hits = from.hits;
    p.exposure_per_m2 =
        from.exposure_per_m2 + slice * std::max((time_s - from.time_s) / period_s_, 0.5);
    p.state.mean = from.state.mean * motion.transition.transpose();
    p.state.covariance =
        motion.transition * from.state.covariance * motion.transition.transpose() + motion.noise;
    p.agile_covariance = p.state.covariance +
                         (config_.manoeuvre_factor * config_.manoeuvre_factor - 1.0) * motion.noise;
    p.speed_mps = std::min(from.state.mean.col(1).norm(), config_.max_speed_mps);
    return p;
  }

  Motion MotionOver(double dt_s) const {
    return SingerMotion(dt_s, config_.acceleration_time_s, sigma_);
  }

  Gain GainOf(const Prediction& p, const Plot& plot) const {
    const double noise = StreakVarianceM2(plot, p.speed_mps, period_s_);
    const double distance2 = (plot.position_m - p.state.mean.col(0)).squaredNorm();
    const auto log_density = [&](double variance) {
      return -1.5 * std::log(2.0 * M_PI * variance) - 0.5 * distance2 / variance;
    };
    const double steady = log_density(p.state.covariance(0, 0) + noise);
    const double agile = log_density(p.agile_covariance(0, 0) + noise) + config_.manoeuvre_log;
    return {std::max(steady, agile) + p.log_hit - plot.log_clutter + ShapeLog(plot, p.speed_mps),
            agile > steady};
  }

  Hypothesis Update(const Prediction& p, const Plot& plot, double time_s, const Gain& gain) const {
    const double variance = StreakVarianceM2(plot, p.speed_mps, period_s_);
    const Eigen::Matrix3d& covariance = gain.is_agile ? p.agile_covariance : p.state.covariance;
    const Eigen::Vector3d weight = covariance.col(0) / (covariance(0, 0) + variance);
    Hypothesis h;
    h.score = p.score + gain.log;
    h.time_s = time_s;
    h.hits = p.hits + 1.0;
    h.exposure_per_m2 = p.exposure_per_m2;
    h.state.mean = p.state.mean + (plot.position_m - p.state.mean.col(0)) * weight.transpose();
    h.state.covariance = covariance - weight * covariance.row(0);
    return h;
  }

 private:
  // Returns of a target come as a Poisson process whose rate falls with the square of range. Its
  // scale is unknown and has a gamma prior, so that how often it was seen so far tells how often it
  // should be seen.
  double LogMiss(const Hypothesis& from, double exposure) const {
    const double shape = config_.echo_shape + from.hits;
    const double rate = config_.echo_shape / config_.echo_m2 + from.exposure_per_m2;
    return -shape * std::log1p(exposure / rate);
  }

  static double SliceExposure(const State& state) {
    return 1.0 / std::max(state.mean.col(0).squaredNorm(), 1.0);
  }

  double ShapeLog(const Plot& plot, double speed_mps) const {
    const double extent = plot.extent_m - config_.max_extent_m - speed_mps * period_s_;
    return std::min(std::log(static_cast<double>(plot.returns.size())), config_.max_returns_log) +
           config_.extent_log_per_m * std::max(0.0, extent);
  }

  double sigma_;
  double period_s_;
  const TrackerConfig& config_;
};

double TimeOf(const std::vector<Plot>& plots, std::size_t plot) {
  return static_cast<double>(plots[plot].time_ns - plots.front().time_ns) * kSecondsPerNs;
}

class Search {
 public:
  Search(const std::vector<Plot>& plots, const std::vector<char>& free, const Model& model,
         const TrackerConfig& config)
      : plots_(plots), free_(free), model_(model), config_(config) {
    Run();
  }

  // The best path through plots that are still free.
  Path Best() const {
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

 private:
  void Run() {
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

  void Predict(double time_s) {
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
  void KeepBest(double time_s) {
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

  void Extend(std::int32_t index) {
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
      history_.push_back(model_.Birth(plot, time_s, speed_mps));
      history_.back().plot = index;
    }
  }

  struct Candidate {
    double score;
    Gain gain;
    std::size_t index;
  };

  const std::vector<Plot>& plots_;
  const std::vector<char>& free_;
  Model model_;
  const TrackerConfig& config_;
  std::vector<Hypothesis> history_;
  std::vector<std::int32_t> active_;
  std::vector<Prediction> predictions_;
  std::vector<Candidate> candidates_;
};

// The score of a given sequence of plots, which may hold gaps of any length.
double Score(const std::vector<Plot>& plots, const std::vector<std::uint32_t>& path,
             double period_s, const TrackerConfig& config) {
  double best = -std::numeric_limits<double>::infinity();
  for (const double sigma : config.sigma_a_mps2) {
    const Model model(sigma, period_s, config);
    for (const double speed_mps : config.birth_speeds_mps) {
      Hypothesis h = model.Birth(plots[path.front()], TimeOf(plots, path.front()), speed_mps);
      for (std::size_t k = 1; k < path.size(); ++k) {
        const Plot& plot = plots[path[k]];
        const double time_s = TimeOf(plots, path[k]);
        const Prediction p = model.Predict(h, time_s, model.MotionOver(time_s - h.time_s));
        h = model.Update(p, plot, time_s, model.GainOf(p, plot));
      }
      best = std::max(best, h.score);
    }
  }
  return best;
}

Path Scored(const std::vector<Plot>& plots, std::vector<std::uint32_t> members, double period_s,
            const TrackerConfig& config) {
  Path path;
  path.plots = std::move(members);
  if (!path.plots.empty()) path.score = Score(plots, path.plots, period_s, config);
  return path;
}

// Whether what comes before a cut of one path can go on as what comes after a cut of the other.
bool IsReachable(const std::vector<Plot>& plots, const std::vector<std::uint32_t>& from,
                 std::vector<std::uint32_t>::const_iterator cut_from,
                 const std::vector<std::uint32_t>& to,
                 std::vector<std::uint32_t>::const_iterator cut_to, const TrackerConfig& config) {
  if (cut_from == from.begin() || cut_to == to.end()) return true;
  const Plot& a = plots[*(cut_from - 1)];
  const Plot& b = plots[*cut_to];
  const double dt = static_cast<double>(b.time_ns - a.time_ns) * kSecondsPerNs;
  constexpr double kSlack_m = 2.0;
  return (b.position_m - a.position_m).norm() < config.max_speed_mps * dt + kSlack_m;
}

// The best that two paths can become by joining them or by exchanging what follows some time. A
// path costs `birth_cost`, an empty one nothing.
bool Improve(const std::vector<Plot>& plots, double period_s, const TrackerConfig& config, Path* a,
             Path* b) {
  // What is too weak to stand alone is worth nothing.
  const auto value = [&](const Path& path) {
    return path.plots.empty() ? 0.0 : std::max(0.0, path.score - config.birth_cost);
  };
  double best = value(*a) + value(*b) + config.min_exchange_log;
  Path best_a;
  Path best_b;
  const auto consider = [&](std::vector<std::uint32_t> first, std::vector<std::uint32_t> second) {
    Path p = Scored(plots, std::move(first), period_s, config);
    Path q = Scored(plots, std::move(second), period_s, config);
    if (value(p) + value(q) <= best) return;
    best = value(p) + value(q);
    best_a = std::move(p);
    best_b = std::move(q);
  };
  std::vector<std::uint32_t> all;
  std::set_union(a->plots.begin(), a->plots.end(), b->plots.begin(), b->plots.end(),
                 std::back_inserter(all));
  consider(all, {});
  // Exchanges change something only where the next plot is of the other path.
  const auto in_a = [&](std::uint32_t plot) {
    return std::binary_search(a->plots.begin(), a->plots.end(), plot);
  };
  for (std::size_t k = 1; k < all.size(); ++k) {
    if (in_a(all[k]) == in_a(all[k - 1])) continue;
    const auto cut_a = std::lower_bound(a->plots.cbegin(), a->plots.cend(), all[k]);
    const auto cut_b = std::lower_bound(b->plots.cbegin(), b->plots.cend(), all[k]);
    if (!IsReachable(plots, a->plots, cut_a, b->plots, cut_b, config) ||
        !IsReachable(plots, b->plots, cut_b, a->plots, cut_a, config)) {
      continue;
    }
    std::vector<std::uint32_t> first(a->plots.cbegin(), cut_a);
    std::vector<std::uint32_t> second(b->plots.cbegin(), cut_b);
    first.insert(first.end(), cut_b, b->plots.cend());
    second.insert(second.end(), cut_a, a->plots.cend());
    consider(std::move(first), std::move(second));
  }
  if (best_a.plots.empty() && best_b.plots.empty()) return false;
  *a = std::move(best_a);
  *b = std::move(best_b);
  return true;
}

}  // namespace

std::vector<Path> FindPaths(const std::vector<Plot>& plots, double period_s,
                            const TrackerConfig& config) {
  // Most of what a search has found besides its best path stays true when that is taken away, so
  // paths are taken from one search until it holds no more; then what they hid is searched again.
  std::vector<Path> paths;
  std::vector<char> free(plots.size(), 1);
  const auto max_paths = static_cast<std::size_t>(config.max_paths);
  for (bool found = true; found && paths.size() < max_paths;) {
    found = false;
    std::vector<Search> searches;
    for (const double sigma : config.sigma_a_mps2) {
      searches.emplace_back(plots, free, Model(sigma, period_s, config), config);
    }
    while (paths.size() < max_paths) {
      Path best;
      for (const Search& search : searches) {
        Path path = search.Best();
        if (path.score > best.score) best = std::move(path);
      }
      if (best.score < config.min_fragment_log) break;
      for (const std::uint32_t i : best.plots) free[i] = 0;
      paths.push_back(std::move(best));
      found = true;
    }
  }
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t i = 0; i < paths.size(); ++i) {
      for (std::size_t j = i + 1; j < paths.size(); ++j) {
        if (paths[i].plots.empty() || paths[j].plots.empty()) continue;
        changed |= Improve(plots, period_s, config, &paths[i], &paths[j]);
      }
    }
  }
  paths.erase(std::remove_if(paths.begin(), paths.end(),
                             [](const Path& path) { return path.plots.empty(); }),
              paths.end());
  std::stable_sort(paths.begin(), paths.end(),
                   [](const Path& a, const Path& b) { return a.score > b.score; });
  return paths;
}

}  // namespace unlidar
