// The likelihoods of a target: how one of some agility moves, is missed and is seen.
#pragma once

#include <Eigen/Core>
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

// Seconds since the first plot.
double TimeOf(const std::vector<Plot>& plots, std::size_t plot);

// What each plot brings as the first of a path, relative to an even choice among all of them. A
// target may appear anywhere: with a chance in proportion to volume, so a plot is the likelier to
// be its first the rarer clutter is at its place. Normalised, so that the mean of exp is 1.
std::vector<double> LogBirths(const std::vector<Plot>& plots, const TrackerConfig& config);

class TrackModel {
 public:
  TrackModel(double sigma_a_mps2, double period_s, const TrackerConfig& config)
      : sigma_(sigma_a_mps2), period_s_(period_s), config_(config) {}

  Hypothesis Birth(const Plot& plot, double log_birth, double time_s, double speed_mps) const;

  // Score of a hypothesis that was not seen until `time_s`. A long miss is either bad luck or a
  // shadow, whichever is likelier.
  double ScoreAt(const Hypothesis& from, double time_s) const;

  Motion MotionOver(double dt_s) const;

  Prediction Predict(const Hypothesis& from, double time_s, const Motion& motion) const;

  Gain GainOf(const Prediction& p, const Plot& plot) const;

  Hypothesis Update(const Prediction& p, const Plot& plot, double time_s, const Gain& gain) const;

 private:
  double LogMissUntil(const Hypothesis& from, double time_s) const;
  double LogShadow(double dt_s) const;
  double LogMiss(const Hypothesis& from, double exposure) const;
  double ShapeLog(const Plot& plot, double speed_mps) const;

  double sigma_;
  double period_s_;
  const TrackerConfig& config_;
};

}  // namespace unlidar
