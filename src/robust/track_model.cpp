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
  if (x < 0.02) {
    // The exact terms below cancel: the first two of their series are good to 3e-4.
    const double dt2 = dt * dt;
    const double q11 = dt2 * dt2 * dt / 20 * (1 - 5 * x / 9);
    const double q12 = dt2 * dt2 / 8 * (1 - 2 * x / 3);
    const double q13 = dt2 * dt / 6 * (1 - x);
    const double q22 = dt2 * dt / 3 * (1 - 3 * x / 4);
    const double q23 = dt2 / 2 * (1 - x);
    m.noise << q11, q12, q13, q12, q22, q23, q13, q23, dt * (1 - x);
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

// Returns of a target come as a Poisson process whose rate falls with the square of range. Its
// scale is unknown and has a gamma distribution: log probability of none.
double LogUnseen(double shape, double rate, double exposure) {
  return -shape * std::log1p(exposure / rate);
}

double ExposureAt(const Eigen::Vector3d& position_m) {
  return 1.0 / std::max(position_m.squaredNorm(), 1.0);
}

}  // namespace

double TimeOf(const std::vector<Plot>& plots, std::size_t plot) {
  return static_cast<double>(plots[plot].time_ns - plots.front().time_ns) * kSecondsPerNs;
}

std::vector<double> LogBirths(const std::vector<Plot>& plots, const TrackerConfig& config) {
  std::vector<double> logs(plots.size());
  if (plots.empty()) return logs;
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const double log_unseen = LogUnseen(config.echo_shape, config.echo_shape / config.echo_m2,
                                        ExposureAt(plots[i].position_m));
    logs[i] = std::log(-std::expm1(log_unseen)) - plots[i].log_clutter;
  }
  const double largest = *std::max_element(logs.begin(), logs.end());
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(log - largest);
  const double even = config.even_birth_share;
  const double scale = (1.0 - even) * static_cast<double>(plots.size()) / sum;
  for (double& log : logs) log = std::log(even + scale * std::exp(log - largest));
  return logs;
}

TrackModel::TrackModel(double sigma_a_mps2, const Watch& watch, const TrackerConfig& config)
    : sigma_(sigma_a_mps2), period_s_(watch.period_s), config_(config) {
  if (watch.num_sensors == 1) return;
  // Sensors mostly look different ways: the one that saw a target sees it next. So two sensors are
  // no two chances to be seen.
  log_same_sensor_ = std::log1p(-config.sensor_change);
  log_other_sensor_ = std::log(config.sensor_change / (watch.num_sensors - 1.0));
}

Hypothesis TrackModel::Birth(const Plot& plot, double log_birth, double time_s,
                             double speed_mps) const {
  Hypothesis birth;
  birth.score = log_birth;
  birth.time_s = time_s;
  birth.sensor = plot.sensor;
  birth.state.mean.col(0) = plot.position_m;
  birth.state.covariance.diagonal() << plot.variance_m2, speed_mps * speed_mps, sigma_ * sigma_;
  SetVisibility(&birth);
  return birth;
}

double TrackModel::ScoreUnseen(const Hypothesis& from, double time_s) const {
  const double missed = std::max(0.0, std::round((time_s - from.time_s) / period_s_) - 1.0);
  return from.score + LogMiss(from, missed * from.slice_per_m2);
}

Motion TrackModel::MotionOver(double dt_s) const {
  return SingerMotion(dt_s, config_.acceleration_time_s, sigma_);
}

Prediction TrackModel::Predict(const Hypothesis& from, double score, const Motion& motion) const {
  Prediction p;
  p.score = score;
  p.log_hit = from.log_hit;
  p.sensor = from.sensor;
  p.speed_mps = std::min(from.state.mean.col(1).norm(), config_.max_speed_mps);
  const auto onto_position = motion.transition.row(0);
  p.position_m = from.state.mean * onto_position.transpose();
  p.variance_m2 = onto_position * from.state.covariance * onto_position.transpose();
  p.variance_m2 += motion.noise(0, 0);
  p.agile_variance_m2 = p.variance_m2 + AgileFactor() * motion.noise(0, 0);
  return p;
}

Gain TrackModel::GainOf(const Prediction& p, const Plot& plot) const {
  const double noise = StreakVarianceM2(plot, p.speed_mps, period_s_);
  const double distance2 = (plot.position_m - p.position_m).squaredNorm();
  const auto log_density = [&](double variance) {
    return -1.5 * std::log(2.0 * M_PI * variance) - 0.5 * distance2 / variance;
  };
  const double steady = log_density(p.variance_m2 + noise);
  const double agile = log_density(p.agile_variance_m2 + noise) + config_.manoeuvre_log;
  return {std::max(steady, agile) + p.log_hit - plot.log_clutter +
              (p.sensor == plot.sensor ? log_same_sensor_ : log_other_sensor_),
          agile > steady};
}

Hypothesis TrackModel::Update(const Hypothesis& from, const Motion& motion, const Prediction& p,
                              const Plot& plot, double time_s, const Gain& gain) const {
  const double variance = StreakVarianceM2(plot, p.speed_mps, period_s_);
  Eigen::Matrix3d covariance =
      motion.transition * from.state.covariance * motion.transition.transpose() + motion.noise;
  if (gain.is_agile) covariance += AgileFactor() * motion.noise;
  const Eigen::Vector3d weight = covariance.col(0) / (covariance(0, 0) + variance);
  Hypothesis h;
  h.score = p.score + gain.log;
  h.time_s = time_s;
  h.sensor = plot.sensor;
  h.hits = from.hits + 1.0;
  h.exposure_per_m2 =
      from.exposure_per_m2 + from.slice_per_m2 * std::max((time_s - from.time_s) / period_s_, 0.5);
  h.state.mean = from.state.mean * motion.transition.transpose();
  h.state.mean += (plot.position_m - p.position_m) * weight.transpose();
  h.state.covariance = covariance - weight * covariance.row(0);
  SetVisibility(&h);
  return h;
}

ScoreBound TrackModel::BoundOf(const Prediction& p, const VarianceRange& variances) const {
  const double streak_m = p.speed_mps * period_s_;
  const double largest_m2 = variances.largest_m2 + streak_m * streak_m / 36.0;
  const double common = p.score + p.log_hit;
  const auto peak = [&](double variance) { return -1.5 * std::log(2.0 * M_PI * variance); };
  return {common + peak(p.variance_m2 + variances.least_m2), 0.5 / (p.variance_m2 + largest_m2),
          common + peak(p.agile_variance_m2 + variances.least_m2) + config_.manoeuvre_log,
          0.5 / (p.agile_variance_m2 + largest_m2)};
}

// How often it was seen so far tells how often it should be seen.
double TrackModel::LogMiss(const Hypothesis& from, double exposure) const {
  return LogUnseen(config_.echo_shape + from.hits,
                   config_.echo_shape / config_.echo_m2 + from.exposure_per_m2, exposure);
}

void TrackModel::SetVisibility(Hypothesis* h) const {
  h->slice_per_m2 = ExposureAt(h->state.mean.col(0));
  h->log_hit = std::log(std::max(-std::expm1(LogMiss(*h, h->slice_per_m2)), 1e-6));
}

double TrackModel::AgileFactor() const {
  return config_.manoeuvre_factor * config_.manoeuvre_factor - 1.0;
}

}  // namespace unlidar
