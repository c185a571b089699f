#include "tracking/track_model.hpp"

#include <algorithm>
#include <cmath>

#include "scene/stations.hpp"

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
double StreakVarianceM2(const Plot& plot, double speed_mps) {
  const double along_m = speed_mps * plot.streak_s;
  return plot.variance_m2 + along_m * along_m / 12.0 / static_cast<double>(plot.num_returns) / 3.0;
}

// How long after the middle of its frame a plot was measured.
double OffsetS(const Plot& plot) {
  return static_cast<double>(plot.time_ns - plot.frame_time_ns) * kSecondsPerNs;
}

// Returns of a target come as a Poisson process whose rate falls with the square of range. Its
// scale is unknown and has a gamma distribution: log probability of none.
double LogUnseen(double shape, double rate, double exposure) {
  return -shape * std::log1p(exposure / rate);
}

double PerM2(const Eigen::Vector3d& ray_m) { return 1.0 / std::max(ray_m.squaredNorm(), 1.0); }

double LogHitOf(double log_miss) { return std::log(std::max(-std::expm1(log_miss), 1e-6)); }

// How many frames of the sensor that saw it last a target was not seen in. None where that was at
// the same instant: the frame of its last plot is not before it.
double MissedFrames(const Hypothesis& from, const Moment& at) {
  const std::uint32_t before = at.frames_before[from.sensor];
  return before > from.frames ? before - from.frames : 0.0;
}

}  // namespace

Watch WatchOf(const Recording& recording) {
  Watch watch;
  const Stations stations(recording.sensors);
  for (std::uint32_t s = 0; s < recording.sensors.size(); ++s) {
    const TimeNs period_ns = recording.sensors[s].frame_period_ns;
    watch.sensors.push_back({static_cast<double>(period_ns) * kSecondsPerNs,
                             {},
                             stations.ViewpointM(stations.StationOf(s)).cast<double>()});
  }
  for (const FrameInfo& frame : recording.frames) {
    watch.sensors[frame.sensor].frame_times_ns.push_back(frame.middle_ns());
  }
  for (Watch::Sensor& sensor : watch.sensors) {
    std::sort(sensor.frame_times_ns.begin(), sensor.frame_times_ns.end());
  }
  return watch;
}

std::uint32_t Watch::FramesBefore(std::uint32_t sensor, TimeNs time_ns) const {
  const std::vector<TimeNs>& times_ns = sensors[sensor].frame_times_ns;
  return static_cast<std::uint32_t>(std::lower_bound(times_ns.begin(), times_ns.end(), time_ns) -
                                    times_ns.begin());
}

Moment MomentOf(const Plot& plot, const Plot& first, const Watch& watch) {
  Moment moment;
  moment.sensor = plot.sensor;
  moment.time_s = static_cast<double>(plot.frame_time_ns - first.frame_time_ns) * kSecondsPerNs;
  for (std::uint32_t s = 0; s < watch.sensors.size(); ++s) {
    moment.frames_before.push_back(watch.FramesBefore(s, plot.frame_time_ns));
  }
  return moment;
}

double LogBirthOdds(const Plot& plot, const Watch& watch, const TrackerConfig& config) {
  const Watch::Sensor& sensor = watch.sensors[plot.sensor];
  const double log_unseen = LogUnseen(config.echo_shape, config.echo_shape / config.echo_m2_per_s,
                                      sensor.frame_s * PerM2(plot.position_m - sensor.viewpoint_m));
  return std::log(-std::expm1(log_unseen)) - plot.log_clutter;
}

std::vector<double> LogBirths(const std::vector<Plot>& plots, const Watch& watch,
                              const TrackerConfig& config) {
  std::vector<double> logs(plots.size());
  if (plots.empty()) return logs;
  for (std::size_t i = 0; i < plots.size(); ++i) logs[i] = LogBirthOdds(plots[i], watch, config);
  const double largest = *std::max_element(logs.begin(), logs.end());
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(log - largest);
  const double even = config.even_birth_share;
  const double scale = (1.0 - even) * static_cast<double>(plots.size()) / sum;
  for (double& log : logs) log = std::log(even + scale * std::exp(log - largest));
  return logs;
}

TrackModel::TrackModel(double sigma_a_mps2, const Watch& watch, const TrackerConfig& config)
    : sigma_(sigma_a_mps2), config_(&config) {
  SetWatch(watch);
}

void TrackModel::SetWatch(const Watch& watch) {
  frame_s_.clear();
  viewpoints_m_.clear();
  for (const Watch::Sensor& sensor : watch.sensors) {
    frame_s_.push_back(sensor.frame_s);
    viewpoints_m_.push_back(sensor.viewpoint_m);
  }
  if (frame_s_.size() == 1) return;
  // Two sensors are no two chances to be seen.
  log_same_sensor_ = std::log1p(-kSensorChange);
  log_other_sensor_ = std::log(kSensorChange / (static_cast<double>(frame_s_.size()) - 1.0));
}

Hypothesis TrackModel::Birth(const Plot& plot, double log_birth, const Moment& at,
                             double speed_mps) const {
  Hypothesis birth;
  birth.score = log_birth;
  birth.time_s = at.time_s;
  birth.sensor = plot.sensor;
  birth.frames = at.frames_before[plot.sensor] + 1;
  birth.state.mean.col(0) = plot.position_m;
  // Where it was in the middle of the frame depends on its unknown velocity.
  const double offset_s = OffsetS(plot);
  const double velocity_m2_per_s2 = speed_mps * speed_mps;
  Eigen::Matrix3d& covariance = birth.state.covariance;
  covariance.diagonal() << plot.variance_m2 + offset_s * offset_s * velocity_m2_per_s2,
      velocity_m2_per_s2, sigma_ * sigma_;
  covariance(0, 1) = covariance(1, 0) = -offset_s * velocity_m2_per_s2;
  SetVisibility(&birth);
  return birth;
}

double TrackModel::ScoreUnseen(const Hypothesis& from, const Moment& at) const {
  const double missed = MissedFrames(from, at);
  return from.score + LogMiss(from, missed * from.per_frame_s_per_m2);
}

double TrackModel::ScoreBefore(const Hypothesis& from, const Moment& at) const {
  if (at.sensor == from.sensor) return ScoreUnseen(from, at);
  return from.score + LogMissUnknown(MissedFrames(from, at) * from.per_frame_s_per_m2);
}

Motion TrackModel::MotionOver(double dt_s) const {
  return SingerMotion(dt_s, kSearchAccelerationTimeS, sigma_);
}

Prediction TrackModel::Predict(const Hypothesis& from, double score, const Motion& motion,
                               const Moment& at) const {
  Prediction p;
  p.score = score;
  p.log_hit = at.sensor == from.sensor ? from.log_hit
                                       : LogHitOf(LogMissUnknown(PerFrame(at.sensor, from.state)));
  p.sensor = from.sensor;
  p.speed_mps = std::min(from.state.mean.col(1).norm(), config_->max_speed_mps);
  const auto onto_position = motion.transition.row(0);
  const auto onto_velocity = motion.transition.row(1);
  p.position_m = from.state.mean * onto_position.transpose();
  p.velocity_mps = from.state.mean * onto_velocity.transpose();
  const Eigen::Matrix3d& covariance = from.state.covariance;
  const Eigen::Vector3d with_position = covariance * onto_position.transpose();
  p.steady = {onto_position * with_position, onto_velocity * with_position,
              onto_velocity * covariance * onto_velocity.transpose()};
  const auto add_noise = [&](double factor, Spread* spread) {
    spread->position_m2 += factor * motion.noise(0, 0);
    spread->covariance_m2_per_s += factor * motion.noise(0, 1);
    spread->velocity_m2_per_s2 += factor * motion.noise(1, 1);
  };
  add_noise(1.0, &p.steady);
  p.agile = p.steady;
  add_noise(AgileFactor(), &p.agile);
  return p;
}

Gain TrackModel::GainOf(const Prediction& p, const Plot& plot) const {
  const double noise = StreakVarianceM2(plot, p.speed_mps);
  const double offset_s = OffsetS(plot);
  const double distance2 =
      (plot.position_m - p.position_m - offset_s * p.velocity_mps).squaredNorm();
  const auto log_density = [&](double variance) {
    return -1.5 * std::log(2.0 * M_PI * variance) - 0.5 * distance2 / variance;
  };
  const double steady = log_density(p.steady.At(offset_s) + noise);
  const double agile = log_density(p.agile.At(offset_s) + noise) + config_->manoeuvre_log;
  return {std::max(steady, agile) + p.log_hit - plot.log_clutter +
              (p.sensor == plot.sensor ? log_same_sensor_ : log_other_sensor_),
          agile > steady};
}

Hypothesis TrackModel::Update(const Hypothesis& from, const Motion& motion, const Prediction& p,
                              const Plot& plot, const Moment& at, const Gain& gain) const {
  Eigen::Matrix3d covariance =
      motion.transition * from.state.covariance * motion.transition.transpose() + motion.noise;
  if (gain.is_agile) covariance += AgileFactor() * motion.noise;
  // The plot shows the position in the middle of the frame, moved on by the velocity.
  const double offset_s = OffsetS(plot);
  const Eigen::Vector3d seen = covariance.col(0) + offset_s * covariance.col(1);
  const double variance = seen[0] + offset_s * seen[1] + StreakVarianceM2(plot, p.speed_mps);
  const Eigen::Vector3d weight = seen / variance;
  Hypothesis h;
  h.score = p.score + gain.log;
  h.time_s = at.time_s;
  h.sensor = plot.sensor;
  h.frames = at.frames_before[plot.sensor] + 1;
  h.num_plots = from.num_plots + 1;
  // Frames in which it was missed, and that of the plot.
  h.hits = 1.0;
  h.exposure_s_per_m2 = from.per_frame_s_per_m2 * MissedFrames(from, at);
  if (plot.sensor == from.sensor) {
    h.hits += from.hits;
    h.exposure_s_per_m2 += from.exposure_s_per_m2 + from.per_frame_s_per_m2;
  } else {
    h.exposure_s_per_m2 += PerFrame(plot.sensor, from.state);
  }
  h.state.mean = from.state.mean * motion.transition.transpose();
  h.state.mean += (plot.position_m - p.position_m - offset_s * p.velocity_mps) * weight.transpose();
  h.state.covariance = covariance - weight * seen.transpose();
  SetVisibility(&h);
  return h;
}

Hypothesis TrackModel::Follow(const Hypothesis& from, const Plot& plot, const Moment& at) const {
  const Motion motion = MotionOver(at.time_s - from.time_s);
  const Prediction p = Predict(from, ScoreBefore(from, at), motion, at);
  return Update(from, motion, p, plot, at, GainOf(p, plot));
}

ScoreBound TrackModel::BoundOf(const Prediction& p, const FrameBounds& frame) const {
  const double streak_m = p.speed_mps * frame.streak_s;
  const double largest_m2 = frame.largest_variance_m2 + streak_m * streak_m / 36.0;
  const double common = p.score + p.log_hit;
  const auto peak = [&](const Spread& spread) {
    return common -
           1.5 * std::log(2.0 * M_PI * (spread.Least(frame.half_span_s) + frame.least_variance_m2));
  };
  const auto slope = [&](const Spread& spread) {
    return 0.5 / (spread.Largest(frame.half_span_s) + largest_m2);
  };
  return {peak(p.steady), slope(p.steady), peak(p.agile) + config_->manoeuvre_log, slope(p.agile),
          frame.half_span_s * p.velocity_mps.norm()};
}

// How often it was seen so far tells how often it should be seen.
double TrackModel::LogMiss(const Hypothesis& from, double exposure_s_per_m2) const {
  return LogUnseen(config_->echo_shape + from.hits,
                   config_->echo_shape / config_->echo_m2_per_s + from.exposure_s_per_m2,
                   exposure_s_per_m2);
}

double TrackModel::LogMissUnknown(double exposure_s_per_m2) const {
  return LogUnseen(config_->echo_shape, config_->echo_shape / config_->echo_m2_per_s,
                   exposure_s_per_m2);
}

double TrackModel::PerFrame(std::uint32_t sensor, const State& state) const {
  return frame_s_[sensor] * PerM2(state.mean.col(0) - viewpoints_m_[sensor]);
}

void TrackModel::SetVisibility(Hypothesis* h) const {
  h->per_frame_s_per_m2 = PerFrame(h->sensor, h->state);
  h->log_hit = LogHitOf(LogMiss(*h, h->per_frame_s_per_m2));
}

double TrackModel::AgileFactor() const { return kManoeuvreFactor * kManoeuvreFactor - 1.0; }

std::vector<Hypothesis> FollowPath(const TrackModel& model, const std::vector<const Plot*>& plots,
                                   const std::vector<Moment>& moments, double log_birth,
                                   const TrackerConfig& config) {
  std::vector<Hypothesis> best;
  for (const double speed_mps : config.birth_speeds_mps) {
    std::vector<Hypothesis> way;
    way.push_back(model.Birth(*plots.front(), log_birth, moments.front(), speed_mps));
    for (std::size_t k = 1; k < plots.size(); ++k) {
      way.push_back(model.Follow(way.back(), *plots[k], moments[k]));
    }
    if (best.empty() || way.back().score > best.back().score) best = std::move(way);
  }
  return best;
}

}  // namespace unlidar
