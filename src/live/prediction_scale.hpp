// Errors of a track's predictions, relative to the covariance that its fit states.
#pragma once

#include <Eigen/Core>

#include "unlidar/types.hpp"

namespace unlidar {

// Error of a prediction at a new measurement.
struct PredictionError {
  TimeNs time_ns = 0;                                         // of the measurement
  Eigen::Vector3d error_m = Eigen::Vector3d::Zero();          // measured less predicted
  Eigen::Matrix3d predicted_m2 = Eigen::Matrix3d::Zero();     // covariance that the fit states
  Eigen::Matrix3d measured_m2 = Eigen::Matrix3d::Identity();  // covariance of the measurement
};

// Ratio lambda of the variance of a track's predictions to that stated by its fit. The fit
// estimates the agility of the target over seconds; where it stops at once, the newest velocity is
// wrong by more than that, and where it hovers, by less. The error e = z - x of a prediction at a
// new measurement is normal with covariance lambda P + R. ln lambda is a hidden Markov chain: a
// level is kept for a second on average, and is then drawn anew about the mean of the track, which
// is unknown, too. Both are marginalised over by Bayes' rule, so that a track with few measurements
// stays close to the prior. Does not allocate.
class PredictionScale {
 public:
  PredictionScale();

  // An error earlier than the newest one so far counts as one of the same time.
  void Observe(const PredictionError& error);

  // Posterior mean of lambda at a time. The error of the last estimate keeps its level until a
  // measurement corrects it, so that without any the variance of a prediction never falls.
  double VarianceRatioAt(TimeNs time_ns) const;

  // Levels of lambda: from 1/16 to 256, in half octaves. Means: in octaves.
  static constexpr int kLevels = 25;
  static constexpr int kMeans = 5;
  using Shares = Eigen::Array<double, kLevels, kMeans>;  // of probability

 private:
  double ShareKept(TimeNs time_ns) const;

  Shares shares_;  // posterior of level and mean at time_ns_
  TimeNs time_ns_ = 0;
};

}  // namespace unlidar
