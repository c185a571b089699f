// The likelihoods of a target: how one of some agility moves, is missed and is seen.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tracking/tracker.hpp"

namespace unlidar {

inline constexpr std::int32_t kNoIndex = -1;

// A manoeuvre is so much more agile than the motion it interrupts: one of the three motions tried
// is about as much above the next.
constexpr double kManoeuvreFactor = 3.0;

// How long an acceleration lasts in the search; a trajectory's own time is found when it is fitted.
constexpr double kSearchAccelerationTimeS = 2.0;

// Sensors mostly look different ways: the one that saw a target sees it next, but for this share.
constexpr double kSensorSwitchProbability = 0.1;

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

struct Hypothesis {
  double score = 0.0;
  double time_s = 0.0;             // middle of the frame of its last plot
  double num_detections = 0.0;     // plots of its sensor since another one saw it, or the first,
  double exposure_s_per_m2 = 0.0;  // and the sum over the frames in which it could be seen, of
  double frame_exposure_s_per_m2 = 0.0;    // how long a frame lasts over range^2
  double log_detection_probability = 0.0;  // log probability of being seen in a frame of its sensor
  State state;
  std::uint32_t sensor = 0;     // of its last plot
  std::uint32_t frames = 0;     // of that sensor so far
  std::uint32_t num_plots = 1;  // in all
  std::int32_t plot = 0;
  std::int32_t parent = kNoIndex;  // index into the history
};

// Variances per axis of a position and a velocity, and their covariance.
struct AxisVariances {
  double position_m2 = 0.0;
  double covariance_m2_per_s = 0.0;
  double velocity_m2_per_s2 = 0.0;

  // Of the position so much later, at that velocity.
  double At(double dt_s) const {
    return position_m2 + dt_s * (2.0 * covariance_m2_per_s + dt_s * velocity_m2_per_s2);
  }

  // The least and largest of At within [-half_span_s, half_span_s].
  double Min(double half_span_s) const {
    if (std::abs(covariance_m2_per_s) >= half_span_s * velocity_m2_per_s2) {
      return std::min(At(-half_span_s), At(half_span_s));
    }
    return At(-covariance_m2_per_s / velocity_m2_per_s2);
  }
  double Max(double half_span_s) const { return std::max(At(-half_span_s), At(half_span_s)); }
};

// Where a hypothesis expects its next plot: of its state only what the likelihood of a plot needs.
struct Prediction {
  std::int32_t history = kNoIndex;
  std::uint32_t motion = 0;  // index of that since its last plot
  double score = 0.0;        // misses on the way counted
  double log_detection_probability = 0.0;
  double speed_mps = 0.0;    // of the hypothesis
  std::uint32_t sensor = 0;  // that saw it last
  // At the middle of the frame; a plot may lie before or after it.
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
  AxisVariances steady;
  AxisVariances agile;  // had it manoeuvred on the way
};

// What a plot adds to the score of a prediction.
struct ScoreIncrement {
  double log = 0.0;
  bool is_agile = false;  // a manoeuvre explains it better
};

// What the plots of a frame have in common, and how far they differ.
struct FrameBounds {
  double min_variance_m2 = 0.0;
  double max_variance_m2 = 0.0;
  double streak_s = 0.0;
  double half_span_s = 0.0;  // no plot is farther from the middle of the frame
};

// Upper bound of the score that a prediction and a plot at some distance make, but for what belongs
// to the plot alone: no logarithm for each pair of them.
struct ScoreBound {
  double steady_top = 0.0;
  double steady_slope = 0.0;  // per squared distance
  double agile_top = 0.0;
  double agile_slope = 0.0;
  double travel_m = 0.0;  // within the frame, either way from its middle

  double At(double distance2_m2) const {
    if (travel_m > 0.0) {
      const double left_m = std::max(0.0, std::sqrt(distance2_m2) - travel_m);
      distance2_m2 = left_m * left_m;
    }
    return std::max(steady_top - steady_slope * distance2_m2,
                    agile_top - agile_slope * distance2_m2);
  }

  // Where the bound falls below `score`; negative if it does everywhere.
  double ReachM(double score) const {
    const double reach_m2 =
        std::max((steady_top - score) / steady_slope, (agile_top - score) / agile_slope);
    return reach_m2 < 0.0 ? -1.0 : std::sqrt(reach_m2) + travel_m;
  }
};

// The middle of a frame, and how often a target could have been seen until then.
struct FrameTime {
  double time_s = 0.0;                       // since the frame of the first plot
  std::vector<std::uint32_t> frames_before;  // (sensors)
  std::uint32_t sensor = 0;                  // that took the frame
};

// Of the frame of a plot. The first plot is that of the earliest frame.
FrameTime FrameTimeOf(const Plot& plot, const Plot& first, const ScanSchedule& scan_schedule);

// Log of the chance that a target which appears somewhere is seen at a plot, over the clutter
// there.
double LogBirthOdds(const Plot& plot, const ScanSchedule& scan_schedule,
                    const TrackerConfig& config);

// What each plot brings as the first of a path, relative to an even choice among all of them. A
// target may appear anywhere that it can be seen: with a chance in proportion to volume, so a plot
// is the likelier to be its first the rarer clutter is at its place. Normalised, so that the mean
// of exp is 1.
std::vector<double> LogBirths(const std::vector<Plot>& plots, const ScanSchedule& scan_schedule,
                              const TrackerConfig& config);

class TrackModel {
 public:
  TrackModel(double sigma_a_mps2, const ScanSchedule& scan_schedule, const TrackerConfig& config);

  // Takes on other sensors.
  void SetScanSchedule(const ScanSchedule& scan_schedule);

  Hypothesis Birth(const Plot& plot, double log_birth, const FrameTime& at, double speed_mps) const;

  // Score of a hypothesis that was not seen in the frames until `at` by the sensor that saw it
  // last.
  double ScoreAfterMisses(const Hypothesis& from, const FrameTime& at) const;

  // The same before it is seen in the frame at `at`. If that is another sensor's, the target has
  // left what the last one sees: how often it was seen there tells nothing of since then.
  double PredictedScore(const Hypothesis& from, const FrameTime& at) const;

  Motion MotionOver(double dt_s) const;

  // `score`: of the hypothesis before the frame at `at`, over `motion`.
  Prediction Predict(const Hypothesis& from, double score, const Motion& motion,
                     const FrameTime& at) const;

  ScoreIncrement ScoreIncrementOf(const Prediction& p, const Plot& plot) const;

  // The hypothesis that goes on with a plot of the frame at `at`, for which it was predicted.
  Hypothesis Update(const Hypothesis& from, const Motion& motion, const Prediction& p,
                    const Plot& plot, const FrameTime& at, const ScoreIncrement& increment) const;

  // The hypothesis that goes on with a plot of the frame at `at`, unseen until then.
  Hypothesis PredictAndUpdate(const Hypothesis& from, const Plot& plot, const FrameTime& at) const;

  ScoreBound BoundOf(const Prediction& p, const FrameBounds& frame) const;

 private:
  void SetDetectionProbability(Hypothesis* h) const;
  double ManoeuvreNoiseFactor() const;  // further noise of a manoeuvre
  double LogMissProbability(const Hypothesis& from, double exposure_s_per_m2) const;
  double LogPriorMissProbability(
      double exposure_s_per_m2) const;  // nothing is known of how it is seen
  double ExposureOfFrame(std::uint32_t sensor, const State& state) const;

  double sigma_;
  std::vector<double> frame_s_;                // (sensors)
  std::vector<Eigen::Vector3d> viewpoints_m_;  // (sensors)
  double log_same_sensor_ = 0.0;               // of the next plot to be that of the same sensor,
  double log_other_sensor_ = 0.0;              // or of a certain other one
  const TrackerConfig* config_;
};

// The hypotheses (plots) that go on from one plot to the next, with the first velocity that suits
// them best. `frame_times` (plots): of their frames.
std::vector<Hypothesis> FilterPath(const TrackModel& model, const std::vector<const Plot*>& plots,
                                   const std::vector<FrameTime>& frame_times, double log_birth,
                                   const TrackerConfig& config);

}  // namespace unlidar
