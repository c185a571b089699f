#include "tracking/track_model.hpp"

namespace unlidar {
namespace {

constexpr double kImpossible = -std::numeric_limits<double>::infinity();

Motion SingerMotion(double dt, double tau, double sigma) {
  const double a = 1.0 / tau;
  const double x = a * dt;
  const double e = std::exp(-x);
  Motion m;
  m.transition << 1, dt, (x - 1 + e) / (a * a), 0, 1, (1 - e) / a, 0, 0, e;
  if (x < 0.02) {
    // The exact terms below cancel: two terms of their series are accurate to 3e-4.
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

// Variance per axis of a plot of a target at `speed_mps` without point times: a streak along its
// motion, a third of whose variance falls on each axis.
double StreakVarianceM2(const Plot& plot, double speed_mps) {
  const double along_m = speed_mps * plot.streak_s;
  return plot.variance_m2 + along_m * along_m / 12.0 / static_cast<double>(plot.num_returns) / 3.0;
}

// Time of a plot after the middle of its frame.
double OffsetS(const Plot& plot) { return SecondsOf(plot.time_ns - plot.frame_time_ns); }

// Log probability of no return in an exposure, after some detections in an earlier one: a Poisson
// process whose rate falls with the square of range and has an unknown scale with a gamma prior.
// method.md (7).
double LogMissProbability(double num_detections, double earlier_exposure, double exposure,
                          const TrackerConfig& config) {
  const double rate = kReturnRateShape / config.return_rate_m2_per_s + earlier_exposure;
  return -(kReturnRateShape + num_detections) * std::log1p(exposure / rate);
}

double LogDetectionProbability(double log_miss_probability) {
  return std::log(std::max(-std::expm1(log_miss_probability), 1e-6));
}

// Number of frames of the last sensor since the last plot. Zero at the same instant, as the frame
// of the last plot is not before it.
double NumMissedDetections(const Hypothesis& from, const FrameTime& at) {
  const std::uint32_t before = at.frames_before[from.sensor];
  return before > from.frames ? before - from.frames : 0.0;
}

double LogOutOfView(TimeOutOfView time_out_of_view, const TrackerConfig& config) {
  if (time_out_of_view == TimeOutOfView::kNone) return kImpossible;
  return std::log(config.out_of_view_probability);
}

AxisVariances WithNoise(const AxisVariances& variances, double factor, const Motion& motion) {
  return {variances.position_m2 + factor * motion.noise(0, 0),
          variances.covariance_m2_per_s + factor * motion.noise(0, 1),
          variances.velocity_m2_per_s2 + factor * motion.noise(1, 1)};
}

Eigen::Vector3d VelocityAfter(const State& state, const Motion& motion) {
  return state.mean.col(1) + motion.transition(1, 2) * state.mean.col(2);
}

}  // namespace

void FrameBounds::Include(const Plot& plot) {
  min_variance_m2 = std::min(min_variance_m2, plot.variance_m2);
  max_variance_m2 = std::max(max_variance_m2, plot.variance_m2);
  streak_s = std::max(streak_s, plot.streak_s);
  half_span_s = std::max(half_span_s, std::abs(OffsetS(plot)));
}

Eigen::Vector3d PositionAfter(const State& state, const Motion& motion) {
  return state.mean.col(0) + (motion.transition(0, 1) * state.mean.col(1) +
                              motion.transition(0, 2) * state.mean.col(2));
}

AxisVariances SteadyVariancesOf(const State& state, const Motion& motion) {
  const Eigen::Matrix3d& before = state.covariance;
  const double dt = motion.transition(0, 1);
  const double da = motion.transition(0, 2);
  const double va = motion.transition(1, 2);
  const Eigen::Vector3d position = before.col(0) + (dt * before.col(1) + da * before.col(2));
  const Eigen::Vector3d velocity = before.row(1) + va * before.row(2);
  return WithNoise({position[0] + (dt * position[1] + da * position[2]),
                    position[1] + va * position[2], velocity[1] + va * velocity[2]},
                   1.0, motion);
}

AxisVariances AgileVariancesOf(const AxisVariances& steady, const Motion& motion) {
  return WithNoise(steady, kManoeuvreNoiseFactor, motion);
}

double TopOf(double score, const AxisVariances& variances, const FrameBounds& frame) {
  return score -
         1.5 * std::log(2.0 * M_PI * (variances.Min(frame.half_span_s) + frame.min_variance_m2));
}

FrameTime FrameTimeOf(const Plot& plot, TimeNs begin_ns, const ScanSchedule& scan_schedule) {
  FrameTime frame_time;
  frame_time.sensor = plot.sensor;
  frame_time.viewpoint_m = plot.ViewpointM();
  frame_time.time_s = SecondsOf(plot.frame_time_ns - begin_ns);
  for (std::uint32_t s = 0; s < scan_schedule.sensors.size(); ++s) {
    frame_time.frames_before.push_back(scan_schedule.FramesBefore(s, plot.frame_time_ns));
  }
  return frame_time;
}

double LogBirthOdds(const Plot& plot, const ScanSchedule& scan_schedule,
                    const TrackerConfig& config) {
  const ScanSchedule::Sensor& sensor = scan_schedule.sensors[plot.sensor];
  const double log_no_return =
      LogMissProbability(0.0, 0.0, sensor.frame_s * PerM2(plot.ray_m), config);
  return std::log(-std::expm1(log_no_return)) - plot.log_clutter;
}

std::vector<double> LogBirths(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                              const TrackerConfig& config) {
  std::vector<double> logs(plots.size());
  if (plots.empty()) return logs;
  std::transform(plots.begin(), plots.end(), logs.begin(),
                 [&](const Plot& plot) { return LogBirthOdds(plot, scan_schedule, config); });
  const double largest = *std::max_element(logs.begin(), logs.end());
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(log - largest);
  const double uniform = config.uniform_birth_share;
  const double scale = (1.0 - uniform) * static_cast<double>(plots.size()) / sum;
  for (double& log : logs) log = std::log(uniform + scale * std::exp(log - largest));
  return logs;
}

TrackModel::TrackModel(double sigma_a_mps2, const ScanSchedule& scan_schedule,
                       const TrackerConfig& config, TimeOutOfView time_out_of_view)
    : sigma_(sigma_a_mps2),
      log_out_of_view_(LogOutOfView(time_out_of_view, config)),
      config_(&config) {
  SetScanSchedule(scan_schedule);
}

TrackModel TrackModel::With(TimeOutOfView time_out_of_view) const {
  TrackModel model = *this;
  model.log_out_of_view_ = LogOutOfView(time_out_of_view, *config_);
  return model;
}

void TrackModel::SetScanSchedule(const ScanSchedule& scan_schedule) {
  frame_s_.clear();
  for (const ScanSchedule::Sensor& sensor : scan_schedule.sensors) {
    frame_s_.push_back(sensor.frame_s);
  }
  if (frame_s_.size() == 1) return;
  // The next plot is of one sensor: the probabilities of all sensors sum to 1.
  log_same_sensor_ = std::log1p(-kSensorSwitchProbability);
  log_other_sensor_ =
      std::log(kSensorSwitchProbability / (static_cast<double>(frame_s_.size()) - 1.0));
}

Hypothesis TrackModel::Birth(const Plot& plot, double log_birth, const FrameTime& at,
                             double speed_mps) const {
  Hypothesis birth;
  birth.score = log_birth;
  birth.time_s = at.time_s;
  birth.sensor = plot.sensor;
  birth.frames = at.frames_before[plot.sensor] + 1;
  birth.state.mean.col(0) = plot.position_m;
  // The position in the middle of the frame depends on the unknown velocity.
  const double offset_s = OffsetS(plot);
  const double velocity_m2_per_s2 = speed_mps * speed_mps;
  Eigen::Matrix3d& covariance = birth.state.covariance;
  covariance.diagonal() << plot.variance_m2 + offset_s * offset_s * velocity_m2_per_s2,
      velocity_m2_per_s2, sigma_ * sigma_;
  covariance(0, 1) = covariance(1, 0) = -offset_s * velocity_m2_per_s2;
  SetDetectionProbability(at, &birth);
  return birth;
}

double TrackModel::ScoreAfterMisses(const Hypothesis& from, const FrameTime& at) const {
  const double missed = NumMissedDetections(from, at);
  const double log_missed = LogMissProbabilityOf(from, missed * from.frame_exposure_s_per_m2);
  return from.score + std::max(LogOutOfViewProbability(missed, from.sensor), log_missed);
}

double TrackModel::PredictedScore(const Hypothesis& from, const FrameTime& at) const {
  if (at.sensor == from.sensor) return ScoreAfterMisses(from, at);
  return from.score +
         LogMissProbability(0.0, 0.0, NumMissedDetections(from, at) * from.frame_exposure_s_per_m2,
                            *config_);
}

Motion TrackModel::MotionOver(double dt_s) const {
  return SingerMotion(dt_s, kSearchAccelerationTimeS, sigma_);
}

Prediction TrackModel::Predict(const Hypothesis& from, double score, const Motion& motion,
                               const FrameTime& at) const {
  Prediction p;
  p.score = score;
  p.log_detection_probability = LogDetectionProbabilityOf(from, at);
  p.sensor = from.sensor;
  p.speed_mps = SpeedOf(from.state);
  p.position_m = PositionAfter(from.state, motion);
  p.velocity_mps = VelocityAfter(from.state, motion);
  p.steady = SteadyVariancesOf(from.state, motion);
  p.agile = AgileVariancesOf(p.steady, motion);
  return p;
}

ScoreIncrement TrackModel::ScoreIncrementOf(const Prediction& p, const Plot& plot) const {
  const double noise = StreakVarianceM2(plot, p.speed_mps);
  const double offset_s = OffsetS(plot);
  const Eigen::Vector3d innovation_m = plot.position_m - p.position_m - offset_s * p.velocity_mps;
  const double distance2 = innovation_m.squaredNorm();
  const auto log_density = [&](double variance) {
    return -1.5 * std::log(2.0 * M_PI * variance) - 0.5 * distance2 / variance;
  };
  const double steady_variance = p.steady.At(offset_s) + noise;
  const double steady = log_density(steady_variance);
  // A manoeuvre only widens the density, so near the prediction it is no likelier than its prior.
  const bool may_be_agile =
      0.5 * distance2 / steady_variance > -config_->manoeuvre_log_probability - kRoundingSlack;
  const double agile_variance = p.agile.At(offset_s) + noise;
  const double agile =
      may_be_agile ? log_density(agile_variance) + config_->manoeuvre_log_probability : kImpossible;
  const bool is_agile = agile > steady;
  const AxisVariances& used = is_agile ? p.agile : p.steady;
  const double used_variance = is_agile ? agile_variance : steady_variance;
  const bool is_too_fast =
      (used_variance * p.velocity_mps + used.CovarianceAt(offset_s) * innovation_m).squaredNorm() >
      Square(used_variance * config_->max_speed_mps);
  return {std::max(steady, agile) + p.log_detection_probability - plot.log_clutter +
              (p.sensor == plot.sensor ? log_same_sensor_ : log_other_sensor_),
          is_agile, is_too_fast, distance2 > Square(config_->gate_sigmas) * agile_variance};
}

Hypothesis TrackModel::Update(const Hypothesis& from, const Motion& motion, const Prediction& p,
                              const Plot& plot, const FrameTime& at,
                              const ScoreIncrement& increment) const {
  Eigen::Matrix3d covariance =
      motion.transition * from.state.covariance * motion.transition.transpose() + motion.noise;
  if (increment.is_agile) covariance += kManoeuvreNoiseFactor * motion.noise;
  // The plot measures position + offset_s * velocity at the middle of the frame.
  const double offset_s = OffsetS(plot);
  const Eigen::Vector3d seen = covariance.col(0) + offset_s * covariance.col(1);
  const double variance = seen[0] + offset_s * seen[1] + StreakVarianceM2(plot, p.speed_mps);
  const Eigen::Vector3d kalman_gain = seen / variance;
  Hypothesis h;
  h.score = p.score + increment.log;
  h.time_s = at.time_s;
  h.sensor = plot.sensor;
  h.frames = at.frames_before[plot.sensor] + 1;
  h.num_plots = from.num_plots + 1;
  // Exposure of the missed frames and of the frame of the plot.
  h.num_detections = 1.0;
  h.exposure_s_per_m2 = from.frame_exposure_s_per_m2 * NumMissedDetections(from, at);
  if (plot.sensor == from.sensor) {
    h.num_detections += from.num_detections;
    h.exposure_s_per_m2 += from.exposure_s_per_m2 + from.frame_exposure_s_per_m2;
  } else {
    h.exposure_s_per_m2 += ExposureOfFrame(at, from.state);
  }
  h.state.mean = from.state.mean * motion.transition.transpose();
  h.state.mean +=
      (plot.position_m - p.position_m - offset_s * p.velocity_mps) * kalman_gain.transpose();
  h.state.covariance = covariance - kalman_gain * seen.transpose();
  SetDetectionProbability(at, &h);
  return h;
}

Hypothesis TrackModel::PredictAndUpdate(const Hypothesis& from, const Plot& plot,
                                        const FrameTime& at) const {
  const Motion motion = MotionOver(at.time_s - from.time_s);
  const Prediction p = Predict(from, PredictedScore(from, at), motion, at);
  return Update(from, motion, p, plot, at, ScoreIncrementOf(p, plot));
}

double TrackModel::GainOf(const Hypothesis& from, const Plot& plot, const FrameTime& at) const {
  const Prediction p =
      Predict(from, PredictedScore(from, at), MotionOver(at.time_s - from.time_s), at);
  const ScoreIncrement increment = ScoreIncrementOf(p, plot);
  return increment.is_too_fast ? kImpossible : p.score + increment.log - ScoreAfterMisses(from, at);
}

ScoreBound TrackModel::BoundOf(const State& state, const Motion& motion,
                               const AxisVariances& steady, const AxisVariances& agile,
                               const FrameBounds& frame, double steady_top) const {
  const double streak_m = frame.streak_s > 0.0 ? SpeedOf(state) * frame.streak_s : 0.0;
  const double travel_m =
      frame.half_span_s > 0.0 ? frame.half_span_s * VelocityAfter(state, motion).norm() : 0.0;
  const double max_m2 = frame.max_variance_m2 + streak_m * streak_m / 36.0;
  const auto slope = [&](const AxisVariances& variances) {
    return 0.5 / (variances.Max(frame.half_span_s) + max_m2);
  };
  // A manoeuvre only widens the density: at its top it is no likelier than its prior.
  return {steady_top, slope(steady), steady_top + config_->manoeuvre_log_probability, slope(agile),
          travel_m};
}

double TrackModel::LogDetectionProbabilityOf(const Hypothesis& from, const FrameTime& at) const {
  if (at.sensor == from.sensor) return from.log_detection_probability;
  return at.sensor == from.other_sensor ? from.other_log_detection_probability
                                        : LogOtherDetectionProbability(at, from.state);
}

double TrackModel::LogOtherDetectionProbability(const FrameTime& at, const State& state) const {
  return LogDetectionProbability(
      LogMissProbability(0.0, 0.0, ExposureOfFrame(at, state), *config_));
}

// The detections so far set the rate of further ones (gamma posterior).
double TrackModel::LogMissProbabilityOf(const Hypothesis& from, double exposure_s_per_m2) const {
  return LogMissProbability(from.num_detections, from.exposure_s_per_m2, exposure_s_per_m2,
                            *config_);
}

double TrackModel::LogOutOfViewProbability(double missed, std::uint32_t sensor) const {
  if (std::isinf(log_out_of_view_)) return log_out_of_view_;
  constexpr double kEulerGamma = 0.5772;  // the sum of 1 / n to N is about ln N + kEulerGamma
  const double log_max_frames = std::log(std::max(config_->max_gap_s / frame_s_[sensor], 1.0));
  return log_out_of_view_ - std::log(std::max(missed, 1.0) * (log_max_frames + kEulerGamma));
}

void TrackModel::SetDetectionProbability(const FrameTime& at, Hypothesis* h) const {
  h->frame_exposure_s_per_m2 = ExposureOfFrame(at, h->state);
  h->log_detection_probability =
      LogDetectionProbability(LogMissProbabilityOf(*h, h->frame_exposure_s_per_m2));
}

}  // namespace unlidar
