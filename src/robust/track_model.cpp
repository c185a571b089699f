#include "track_model.hpp"

#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

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

// Variance of a plot per axis for a target at `speed_mps` whose return times within the frame are
// not known: a streak along its motion, a third of whose variance falls on each axis.
double StreakVarianceM2(const Plot& plot, double speed_mps, double period_s) {
  const double along_m = speed_mps * period_s;
  return plot.variance_m2 +
         along_m * along_m / 12.0 / static_cast<double>(plot.returns.size()) / 3.0;
}

double SliceExposure(const State& state) {
  return 1.0 / std::max(state.mean.col(0).squaredNorm(), 1.0);
}

}  // namespace

double TimeOf(const std::vector<Plot>& plots, std::size_t plot) {
  return static_cast<double>(plots[plot].time_ns - plots.front().time_ns) * kSecondsPerNs;
}

std::vector<double> LogBirths(const std::vector<Plot>& plots, const TrackerConfig& config) {
  std::vector<double> logs(plots.size());
  if (plots.empty()) return logs;
  double rarest = plots.front().log_clutter;
  for (const Plot& plot : plots) rarest = std::min(rarest, plot.log_clutter);
  double sum = 0.0;
  for (const Plot& plot : plots) sum += std::exp(rarest - plot.log_clutter);
  const double even = config.even_birth_share;
  const double scale = (1.0 - even) * static_cast<double>(plots.size()) / sum;
  for (std::size_t i = 0; i < plots.size(); ++i) {
    logs[i] = std::log(even + scale * std::exp(rarest - plots[i].log_clutter));
  }
  return logs;
}

Hypothesis TrackModel::Birth(const Plot& plot, double log_birth, double time_s,
                             double speed_mps) const {
  Hypothesis birth;
  birth.score = log_birth;
  birth.time_s = time_s;
  birth.state.mean.col(0) = plot.position_m;
  birth.state.covariance.diagonal() << plot.variance_m2, speed_mps * speed_mps, sigma_ * sigma_;
  return birth;
}

double TrackModel::ScoreAt(const Hypothesis& from, double time_s) const {
  return from.score + std::max(LogMissUntil(from, time_s), LogShadow(time_s - from.time_s));
}

Motion TrackModel::MotionOver(double dt_s) const {
  return SingerMotion(dt_s, config_.acceleration_time_s, sigma_);
}

Prediction TrackModel::Predict(const Hypothesis& from, double time_s, const Motion& motion) const {
  const double slice = SliceExposure(from.state);
  // It is seen again, so a shadow has ended.
  const double log_emerge = std::log(-std::expm1(config_.shadow_log_per_s * period_s_));
  Prediction p;
  p.score = from.score + std::max(LogMissUntil(from, time_s),
                                  LogShadow(time_s - from.time_s) + log_emerge);
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

Gain TrackModel::GainOf(const Prediction& p, const Plot& plot) const {
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

Hypothesis TrackModel::Update(const Prediction& p, const Plot& plot, double time_s,
                              const Gain& gain) const {
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

double TrackModel::LogMissUntil(const Hypothesis& from, double time_s) const {
  const double missed = std::max(0.0, std::round((time_s - from.time_s) / period_s_) - 1.0);
  return LogMiss(from, missed * SliceExposure(from.state));
}

double TrackModel::LogShadow(double dt_s) const {
  return config_.shadow_log + config_.shadow_log_per_s * dt_s;
}

// Returns of a target come as a Poisson process whose rate falls with the square of range. Its
// scale is unknown and has a gamma prior, so that how often it was seen so far tells how often it
// should be seen.
double TrackModel::LogMiss(const Hypothesis& from, double exposure) const {
  const double shape = config_.echo_shape + from.hits;
  const double rate = config_.echo_shape / config_.echo_m2 + from.exposure_per_m2;
  return -shape * std::log1p(exposure / rate);
}

double TrackModel::ShapeLog(const Plot& plot, double speed_mps) const {
  const double extent = plot.extent_m - config_.max_extent_m - speed_mps * period_s_;
  return std::min(std::log(static_cast<double>(plot.returns.size())), config_.max_returns_log) +
         config_.extent_log_per_m * std::max(0.0, extent) +
         (plot.touches_structure ? config_.touch_log : 0.0);
}

}  // namespace unlidar
