// Target model: motion, detection and missed detection for one standard deviation of acceleration.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "scene/plots.hpp"
#include "tracking/scan_schedule.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

inline constexpr std::int32_t kNoIndex = -1;
inline constexpr std::uint32_t kNoSensor = ~std::uint32_t{0};

// Rounding of log densities that bounds allow for.
constexpr double kRoundingSlack = 1e-9;

// Standard deviation of acceleration in a manoeuvre, relative to the motion that it interrupts:
// about the ratio between the successive values of sigma_a in the search.
constexpr double kManoeuvreFactor = 3.0;
constexpr double kManoeuvreNoiseFactor = kManoeuvreFactor * kManoeuvreFactor - 1.0;  // in addition

// Shape of the gamma prior of a target's return rate: its standard deviation is 0.8 of its mean, as
// drones differ in size and aspect.
constexpr double kReturnRateShape = 1.5;

// Singer's correlation time in the search; a trajectory has its own, estimated when it is fitted.
constexpr double kSearchAccelerationTimeS = 2.0;

// Fields of view mostly differ: the sensor that saw a target last sees it next, except with this
// probability.
constexpr double kSensorSwitchProbability = 0.1;

// Position, velocity, acceleration; the covariance is the same on every axis (isotropic).
struct State {
  Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();  // column 0 position, 1 velocity, 2 acceleration
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

// Singer's model: acceleration decays with time constant tau and standard deviation sigma.
struct Motion {
  // Upper triangular, 1 for position and velocity on the diagonal.
  Eigen::Matrix3d transition = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();
};

struct Hypothesis {
  double score = 0.0;
  double time_s = 0.0;          // middle of the frame of its last plot
  double num_detections = 0.0;  // plots of its sensor since the birth or the last change of sensor
  double exposure_s_per_m2 = 0.0;          // frame exposures since then, summed
  double frame_exposure_s_per_m2 = 0.0;    // frame duration / range^2
  double log_detection_probability = 0.0;  // of the next frame of its sensor,
  // and of that of `other_sensor`, once TrackModel::SetOtherSensor() has set both.
  double other_log_detection_probability = 0.0;
  std::uint32_t other_sensor = kNoSensor;
  bool is_near_ground = false;  // its last plot, once it has two; set by the search
  State state;
  std::uint32_t sensor = 0;     // of its last plot
  std::uint32_t frames = 0;     // of that sensor up to its last plot
  std::uint32_t num_plots = 1;  // of all sensors
  std::int32_t plot = 0;
  std::int32_t node = kNoIndex;    // index into the history of its search,
  std::int32_t parent = kNoIndex;  // and that of the hypothesis that it continues
  double peak_score = 0.0;         // highest of the paths that end at its plots
};

// Variances per axis of a position and a velocity, and their covariance.
struct AxisVariances {
  double position_m2 = 0.0;
  double covariance_m2_per_s = 0.0;
  double velocity_m2_per_s2 = 0.0;

  // Variance of the position after dt_s at constant velocity.
  double At(double dt_s) const {
    return position_m2 + dt_s * (2.0 * covariance_m2_per_s + dt_s * velocity_m2_per_s2);
  }

  // Covariance of that position with the velocity.
  double CovarianceAt(double dt_s) const { return covariance_m2_per_s + dt_s * velocity_m2_per_s2; }

  // Minimum and maximum of At() within [-half_span_s, half_span_s].
  double Min(double half_span_s) const {
    if (std::abs(covariance_m2_per_s) >= half_span_s * velocity_m2_per_s2) {
      return std::min(At(-half_span_s), At(half_span_s));
    }
    return At(-covariance_m2_per_s / velocity_m2_per_s2);
  }
  double Max(double half_span_s) const { return std::max(At(-half_span_s), At(half_span_s)); }
};

// Predicted position of the next plot: the part of the state that the likelihood of a plot needs.
struct Prediction {
  std::uint32_t hypothesis = 0;  // index of the active hypothesis
  std::uint32_t motion = 0;      // index of the motion since its last plot
  double score = 0.0;            // including missed detections up to the frame
  double log_detection_probability = 0.0;
  double speed_mps = 0.0;    // of the hypothesis
  std::uint32_t sensor = 0;  // of the last plot
  // State at the middle of the frame; a plot may be earlier or later.
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
  AxisVariances steady;
  AxisVariances agile;  // after a manoeuvre
};

// Increment of the track score by a plot.
struct ScoreIncrement {
  double log = 0.0;
  bool is_agile = false;        // likelier after a manoeuvre
  bool is_too_fast = false;     // with it the target exceeds TrackerConfig::max_speed_mps
  bool is_beyond_gate = false;  // TrackerConfig::gate_sigmas
};

// Bounds over the plots of a frame.
struct FrameBounds {
  double min_variance_m2 = std::numeric_limits<double>::infinity();
  double max_variance_m2 = 0.0;
  double streak_s = 0.0;
  double half_span_s = 0.0;  // largest time of a plot from the middle of the frame

  void Include(const Plot& plot);
};

// Upper bound of the score of a prediction and a plot at some distance, without the terms that
// depend on the plot alone. It saves a logarithm per pair.
struct ScoreBound {
  double steady_top = 0.0;
  double steady_slope = 0.0;  // per squared distance
  double agile_top = 0.0;
  double agile_slope = 0.0;
  double travel_m = 0.0;  // within the frame, either side of its middle
  // What a plot at the gate loses against one at the prediction; without a gate none is there.
  double gate_log = std::numeric_limits<double>::infinity();

  // Falls with distance; minus infinity beyond the gate.
  double At(double distance2_m2) const {
    if (travel_m > 0.0) {
      const double left_m = std::max(0.0, std::sqrt(distance2_m2) - travel_m);
      distance2_m2 = left_m * left_m;
    }
    if (agile_slope * distance2_m2 > gate_log) return -std::numeric_limits<double>::infinity();
    return std::max(steady_top - steady_slope * distance2_m2,
                    agile_top - agile_slope * distance2_m2);
  }
};

// Position of a state after a motion, and its variances if it did not manoeuvre and if it did.
Eigen::Vector3d PositionAfter(const State& state, const Motion& motion);
AxisVariances SteadyVariancesOf(const State& state, const Motion& motion);
AxisVariances AgileVariancesOf(const AxisVariances& steady, const Motion& motion);

// Returns the highest score of a plot of a frame exactly at a prediction with these variances,
// without the terms that depend on the plot alone. `score`: of the hypothesis, with the log of its
// detection probability.
double TopOf(double score, const AxisVariances& variances, const FrameBounds& frame);

// Middle of a frame, from where it was seen, and the number of earlier frames of each sensor.
struct FrameTime {
  double time_s = 0.0;                       // since the frame of the first plot
  std::vector<std::uint32_t> frames_before;  // (sensors)
  std::uint32_t sensor = 0;                  // of the frame
  Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();
};

// Returns the time of the frame of a plot. `begin_ns`: that of the earliest frame.
FrameTime FrameTimeOf(const Plot& plot, TimeNs begin_ns, const ScanSchedule& scan_schedule);

// Log of P_D / lambda at a plot: detection probability of a new target over the clutter intensity.
double LogBirthOdds(const Plot& plot, const ScanSchedule& scan_schedule,
                    const TrackerConfig& config);

// Log weight of each plot as the first of a path, relative to a uniform choice. Targets appear
// uniformly in volume, so a plot is the likelier to be a birth the rarer clutter is at its place.
// Normalised to mean(exp) = 1. method.md (5).
std::vector<double> LogBirths(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                              const TrackerConfig& config);

// Prior of the number of frames that a target is out of view between two plots: log uniform up to
// the longest gap, so that all numbers together have the probability of being out of view and the
// score stays a likelihood ratio. The search supposes that it is always in view: plots behind a gap
// are not known yet, and strays would continue its paths.
enum class TimeOutOfView { kNone, kLogUniform };

class TrackModel {
 public:
  TrackModel(double sigma_a_mps2, const ScanSchedule& scan_schedule, const TrackerConfig& config,
             TimeOutOfView time_out_of_view = TimeOutOfView::kNone);

  // Returns the same model with another prior of the time out of view.
  TrackModel With(TimeOutOfView time_out_of_view) const;

  void SetScanSchedule(const ScanSchedule& scan_schedule);

  Hypothesis Birth(const Plot& plot, double log_birth, const FrameTime& at, double speed_mps) const;

  // Score of a hypothesis after missed detections in all frames of its last sensor before `at`, or
  // out of view.
  double ScoreAfterMisses(const Hypothesis& from, const FrameTime& at) const;

  // Same, predicted for a plot in the frame at `at`. For another sensor, the target has left the
  // field of view of the last one, so the detection statistics since then do not apply and the
  // prior is used.
  double PredictedScore(const Hypothesis& from, const FrameTime& at) const;

  Motion MotionOver(double dt_s) const;

  // Log of the probability that a hypothesis is seen in the frame at `at`.
  double LogDetectionProbabilityOf(const Hypothesis& from, const FrameTime& at) const;

  // `score`: PredictedScore() of the hypothesis at `at`. `motion`: from its last plot to `at`.
  Prediction Predict(const Hypothesis& from, double score, const Motion& motion,
                     const FrameTime& at) const;

  ScoreIncrement ScoreIncrementOf(const Prediction& p, const Plot& plot) const;

  // Returns the hypothesis updated with a plot of the frame at `at`; `p` is its prediction there.
  Hypothesis Update(const Hypothesis& from, const Motion& motion, const Prediction& p,
                    const Plot& plot, const FrameTime& at, const ScoreIncrement& increment) const;

  // Same, including the prediction; the frames until `at` are missed detections.
  Hypothesis PredictAndUpdate(const Hypothesis& from, const Plot& plot, const FrameTime& at) const;

  // Returns the score of a hypothesis with a plot of the frame at `at` over that with a missed
  // detection there.
  double GainOf(const Hypothesis& from, const Plot& plot, const FrameTime& at) const;

  // Bound of the scores of a state after a motion, of which `steady` and `steady_top` are
  // SteadyVariancesOf() and TopOf(). Its agile top has the density of the steady one, which costs
  // no logarithm; AgileTopOf() is lower.
  ScoreBound BoundOf(const State& state, const Motion& motion, const AxisVariances& steady,
                     const AxisVariances& agile, const FrameBounds& frame, double steady_top) const;
  double AgileTopOf(double score, const AxisVariances& agile, const FrameBounds& frame) const {
    return TopOf(score, agile, frame) + config_->manoeuvre_log_probability;
  }

  // Sets the detection probability in frames of another sensor than that of the last plot, seen
  // from where this frame was. It hardly depends on time: a hypothesis that is extended often needs
  // it but once.
  void SetOtherSensor(const FrameTime& at, Hypothesis* h) const {
    h->other_sensor = at.sensor;
    h->other_log_detection_probability = LogOtherDetectionProbability(at, h->state);
  }

 private:
  void SetDetectionProbability(const FrameTime& at, Hypothesis* h) const;
  double SpeedOf(const State& state) const {  // no more than targets fly
    return std::min(state.mean.col(1).norm(), config_->max_speed_mps);
  }
  double LogMissProbabilityOf(const Hypothesis& from, double exposure_s_per_m2) const;
  double LogOutOfViewProbability(double missed, std::uint32_t sensor) const;
  double LogOtherDetectionProbability(const FrameTime& at, const State& state) const;
  double ExposureOfFrame(const FrameTime& at, const State& state) const {
    return frame_s_[at.sensor] * PerM2(state.mean.col(0) - at.viewpoint_m);
  }

  double sigma_;
  std::vector<double> frame_s_;    // (sensors)
  double log_same_sensor_ = 0.0;   // log probability that the next plot is of the same sensor,
  double log_other_sensor_ = 0.0;  // or of one particular other sensor
  double log_out_of_view_;  // log probability of being out of view; minus infinity if it never is
  const TrackerConfig* config_;
};

}  // namespace unlidar
