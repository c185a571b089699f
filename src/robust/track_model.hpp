// The likelihoods of a target: how one of some agility moves, is missed and is seen.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "unlidar/robust/tracker.hpp"

namespace unlidar {

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

struct Hypothesis {
  double score = 0.0;
  double time_s = 0.0;
  double hits = 0.0;             // plots after the first
  double exposure_per_m2 = 0.0;  // sum over the slices in which it could be seen of 1 / range^2
  double slice_per_m2 = 0.0;     // 1 / range^2
  double log_hit = 0.0;          // log probability of being seen in a slice, if nothing hides it
  State state;
  std::uint32_t sensor = 0;  // of its last plot
  std::int32_t plot = 0;
  std::int32_t parent = kNone;  // index into the history
};

// Where a hypothesis expects its next plot: of its state only what the likelihood of a plot needs.
struct Prediction {
  std::int32_t history = kNone;
  std::uint32_t motion = 0;  // index of that since its last plot
  double score = 0.0;        // misses on the way counted
  double log_hit = 0.0;
  double speed_mps = 0.0;
  std::uint32_t sensor = 0;  // that saw it last
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  double variance_m2 = 0.0;        // per axis
  double agile_variance_m2 = 0.0;  // had it manoeuvred on the way
};

// What a plot adds to the score of a prediction.
struct Gain {
  double log = 0.0;
  bool is_agile = false;  // a manoeuvre explains it better
};

// Least and largest variance of the plots of a frame.
struct VarianceRange {
  double least_m2 = 0.0;
  double largest_m2 = 0.0;
};

// Upper bound of the score that a prediction and a plot at some distance make, but for what belongs
// to the plot alone: no logarithm for each pair of them.
struct ScoreBound {
  double steady_top = 0.0;
  double steady_slope = 0.0;  // per squared distance
  double agile_top = 0.0;
  double agile_slope = 0.0;

  double At(double distance2_m2) const {
    return std::max(steady_top - steady_slope * distance2_m2,
                    agile_top - agile_slope * distance2_m2);
  }

  // Where the bound falls below `score`, squared; negative if it does everywhere.
  double ReachM2(double score) const {
    return std::max((steady_top - score) / steady_slope, (agile_top - score) / agile_slope);
  }
};

// Seconds since the first plot.
double TimeOf(const std::vector<Plot>& plots, std::size_t plot);

// What each plot brings as the first of a path, relative to an even choice among all of them. A
// target may appear anywhere that it can be seen: with a chance in proportion to volume, so a plot
// is the likelier to be its first the rarer clutter is at its place. Normalised, so that the mean
// of exp is 1.
std::vector<double> LogBirths(const std::vector<Plot>& plots, const TrackerConfig& config);

class TrackModel {
 public:
  TrackModel(double sigma_a_mps2, const Watch& watch, const TrackerConfig& config);

  Hypothesis Birth(const Plot& plot, double log_birth, double time_s, double speed_mps) const;

  // Score of a hypothesis that was not seen until `time_s`.
  double ScoreUnseen(const Hypothesis& from, double time_s) const;

  Motion MotionOver(double dt_s) const;

  // `score`: of the hypothesis, unseen over `motion`.
  Prediction Predict(const Hypothesis& from, double score, const Motion& motion) const;

  Gain GainOf(const Prediction& p, const Plot& plot) const;

  // The hypothesis that goes on with a plot at `time_s`, for which it was predicted.
  Hypothesis Update(const Hypothesis& from, const Motion& motion, const Prediction& p,
                    const Plot& plot, double time_s, const Gain& gain) const;

  ScoreBound BoundOf(const Prediction& p, const VarianceRange& variances) const;

 private:
  void SetVisibility(Hypothesis* h) const;
  double AgileFactor() const;  // further noise of a manoeuvre
  double LogMiss(const Hypothesis& from, double exposure) const;

  double sigma_;
  double period_s_;
  double log_same_sensor_ = 0.0;   // of the next plot to be that of the same sensor,
  double log_other_sensor_ = 0.0;  // or of a certain other one
  const TrackerConfig& config_;
};

}  // namespace unlidar
