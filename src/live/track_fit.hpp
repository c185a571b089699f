// The latest fit of a track of a stream: trajectory and measurements, and errors of predictions.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/recording.hpp"
#include "collection/sensor_biases.hpp"
#include "live/live_plot.hpp"
#include "scene/plots.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/trajectory_fitter.hpp"

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

class TrackFit {
 public:
  explicit TrackFit(const CollectConfig& config);

  // Sets the measurements: cleared first, then those of plots added from the newest back. The body
  // is a sphere.
  void Clear();
  // Its centre lies `facing_share` times its width behind the returns.
  void AddEarlier(const LivePlot& seen, const Eigen::Vector3d& velocity_mps, double body_sigma_m,
                  double facing_share);

  // Fits the trajectory, with the scales of a recent fit where they still apply. Measurements until
  // `settled_ns` are final.
  void Fit(TimeNs settled_ns, TrajectoryFitter& fitter);

  const Trajectory& trajectory() const { return trajectory_; }
  const std::vector<Measurement>& measurements() const { return measurements_; }  // by time

  // Added to the variance of the trajectory at a time it yields that of a prediction, by how far
  // earlier ones were off: per axis, m^2, negative if they were better than stated.
  Eigen::Vector3d PredictionInflationM2(TimeNs time_ns) const {
    return (prediction_scale_.VarianceRatioAt(time_ns) - 1.0) *
           trajectory_.CovarianceAt(time_ns).diagonal().cwiseMax(0.0);
  }

  // True if the fit uses a plot, and the measurements that it uses: all but outliers.
  bool IsInlier(const Plot& plot) const;
  std::vector<Measurement> InlierMeasurements() const;

  // Returns of the target in frames whose stamps lie in [from_ns, to_ns).
  int ReturnsBetween(TimeNs from_ns, TimeNs to_ns) const;

 private:
  // The plot of a measurement.
  struct PlotRef {
    TimeNs stamp_ns;
    std::uint32_t frame;
    Eigen::Vector3d position_m;
    int num_returns;
  };

  void SortByTime();
  void CorrectForBiases(TimeNs settled_ns);
  void ObservePredictionErrors();
  bool IsOutlier(std::size_t i) const { return trajectory_.weights[i] < 0.5; }
  bool IsNewestOutlier() const;

  Trajectory trajectory_;
  std::vector<SensorMeasurement> sensor_measurements_;
  std::vector<PlotRef> plot_refs_;         // (sensor_measurements_)
  std::vector<Measurement> measurements_;  // likewise, alone
  std::optional<TimeNs> scales_ns_;        // time of the last fit of scales
  PredictionScale prediction_scale_;
  SensorComparison settled_comparison_;  // of final measurements, until compared_until_ns_
  TimeNs compared_until_ns_ = std::numeric_limits<TimeNs>::min();
  std::vector<std::size_t> bias_origins_;  // as they were first
  // Buffers, reused from fit to fit.
  SensorComparison comparison_;  // of all
  std::vector<SensorBias> sensor_biases_;
};

}  // namespace unlidar
