#include "live/track_fit.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "base/maths.hpp"
#include "collection/body.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kScalesNs = 1'500'000'000;  // reuse of the scales of a fit
// Differences between two sensors from which their bias is estimated: at 10 Hz those of the last
// 6 s in which both see the target.
constexpr std::size_t kMaxDifferences = 60;

using Levels = Eigen::Array<double, PredictionScale::kLevels, 1>;
using Shares = PredictionScale::Shares;

constexpr double kLog2 = 0.693147180559945;
constexpr int kLowestHalfOctave = -8;
// Standard deviation of ln lambda within a track: that of ln sigma_a over windows of 5 s of nine
// real flights is 0.59 (docs/notebook/trajectory.md), and a variance has twice that.
constexpr double kLevelSpread = 1.2;
// Centre of the means of tracks, half an octave below what the fit states: its sigma_a is a mean
// over levels, not their median. Centre and holding time maximise the likelihood of innovations,
// which hardly depends on the spread of means: that is chosen by NEES (docs/notebook/streams.md).
constexpr double kMeanCentre = -0.5 * kLog2;
constexpr double kMeanSpread = 0.7;
constexpr double kHoldingTimeS = 1.0;

struct Chain {
  Levels variances;
  Shares prior;  // of level and mean
};

const Chain& TheChain() {
  static const Chain chain = [] {
    Chain made;
    const double lowest = 0.5 * kLog2 * kLowestHalfOctave;
    const Levels logs =
        Levels::LinSpaced(lowest, lowest + 0.5 * kLog2 * (PredictionScale::kLevels - 1));
    made.variances = logs.exp();
    for (int m = 0; m < PredictionScale::kMeans; ++m) {
      const int octave = m - PredictionScale::kMeans / 2;
      const double offset = kLog2 * octave;
      const Levels levels = (-0.5 * ((logs - kMeanCentre - offset) / kLevelSpread).square()).exp();
      made.prior.col(m) = std::exp(-0.5 * Square(offset / kMeanSpread)) / levels.sum() * levels;
    }
    made.prior /= made.prior.sum();
    return made;
  }();
  return chain;
}

// Likelihoods of an error at the levels, up to a factor. The eigenvectors of P v = w R v whiten
// both covariances.
Levels LikelihoodsOf(const PredictionError& error) {
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::Matrix3d> eigen(error.predicted_m2,
                                                                        error.measured_m2);
  const Eigen::Array3d squares =
      (eigen.eigenvectors().transpose() * error.error_m).array().square();
  Levels logs = Levels::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    const Levels variances = 1.0 + std::max(eigen.eigenvalues()[axis], 0.0) * TheChain().variances;
    logs -= 0.5 * (variances.log() + squares[axis] / variances);
  }
  return (logs - logs.maxCoeff()).exp();
}

// Shares of levels drawn anew, given those of the means.
Shares DrawnAnew(const Shares& shares) {
  const Shares& prior = TheChain().prior;
  return prior.rowwise() * (shares.colwise().sum() / prior.colwise().sum());
}

double MeanVariance(const Shares& shares) {
  return (shares.colwise() * TheChain().variances).sum();
}

}  // namespace

PredictionScale::PredictionScale() : shares_(TheChain().prior) {}

double PredictionScale::ShareKept(TimeNs time_ns) const {
  const double elapsed_s = SecondsOf(time_ns - time_ns_);
  return std::exp(-std::max(elapsed_s, 0.0) / kHoldingTimeS);
}

void PredictionScale::Observe(const PredictionError& error) {
  const double kept = ShareKept(error.time_ns);
  Shares shares = kept * shares_ + (1.0 - kept) * DrawnAnew(shares_);
  shares.colwise() *= LikelihoodsOf(error);
  const double sum = shares.sum();
  if (!(sum > 0.0)) return;  // NaN, as of a fit that diverged, or all likelihoods underflow
  shares_ = shares / sum;
  time_ns_ = std::max(time_ns_, error.time_ns);
}

double PredictionScale::VarianceRatioAt(TimeNs time_ns) const {
  const double kept = ShareKept(time_ns);
  const double held = MeanVariance(shares_);
  return std::max(held, kept * held + (1.0 - kept) * MeanVariance(DrawnAnew(shares_)));
}

TrackFit::TrackFit(const CollectConfig& config)
    : settled_comparison_(config, kMaxDifferences), comparison_(settled_comparison_) {}

void TrackFit::Clear() {
  sensor_measurements_.clear();
  plot_refs_.clear();
}

void TrackFit::AddEarlier(const LivePlot& seen, const Eigen::Vector3d& velocity_mps,
                          double body_sigma_m, double facing_share) {
  const Plot& plot = seen.plot;
  SensorMeasurement& added = sensor_measurements_.emplace_back();
  added.sensor = plot.sensor;
  added.station_m = plot.ViewpointM() - plot.shift_m.cast<double>();
  added.velocity_mps = velocity_mps;
  Measurement& m = added.measurement;
  m.time_ns = plot.time_ns;
  m.position_m = plot.position_m + FacingSideOffsetM(body_sigma_m, plot.ray_m, facing_share);
  m.viewpoint_m = plot.ViewpointM();
  m.support = static_cast<int>(plot.num_returns);
  m.covariance_m2 = MeasurementCovarianceM2({body_sigma_m, body_sigma_m, body_sigma_m}, plot.ray_m,
                                            StreakM2(plot.streak_s, velocity_mps),
                                            static_cast<double>(plot.num_returns));
  plot_refs_.push_back({seen.stamp_ns, plot.frame, plot.position_m, m.support});
}

void TrackFit::Fit(TimeNs settled_ns, TrajectoryFitter& fitter) {
  std::reverse(sensor_measurements_.begin(), sensor_measurements_.end());
  std::reverse(plot_refs_.begin(), plot_refs_.end());
  SortByTime();
  CorrectForBiases(settled_ns);
  measurements_.resize(sensor_measurements_.size());
  std::transform(sensor_measurements_.begin(), sensor_measurements_.end(), measurements_.begin(),
                 [](const SensorMeasurement& one) { return one.measurement; });
  ObservePredictionErrors();
  const TimeNs now_ns = measurements_.back().time_ns;
  if (scales_ns_ && now_ns - *scales_ns_ <= kScalesNs) {
    fitter.Refit(measurements_, trajectory_.scales, trajectory_);
    if (!IsNewestOutlier()) return;
  }
  fitter.Fit(measurements_, trajectory_);
  scales_ns_ = now_ns;
}

// Removes the biases of the sensors, as CollectTarget() does.
void TrackFit::CorrectForBiases(TimeNs settled_ns) {
  const auto index_after = [&](TimeNs time_ns) {
    return static_cast<std::size_t>(std::count_if(
        sensor_measurements_.begin(), sensor_measurements_.end(),
        [&](const SensorMeasurement& one) { return one.measurement.time_ns <= time_ns; }));
  };
  // Later measurements may still be compared with others.
  const TimeNs until_ns = settled_ns - NsOf(kSensorOverlapS);
  const std::size_t first = index_after(compared_until_ns_);
  const std::size_t last = std::max(first, index_after(until_ns));
  settled_comparison_.Add(sensor_measurements_, first, last);
  compared_until_ns_ = std::max(compared_until_ns_, until_ns);
  comparison_ = settled_comparison_;
  comparison_.Add(sensor_measurements_, last, sensor_measurements_.size());
  if (!comparison_.HasDifferences()) return;
  // Another origin would move the trajectory.
  if (bias_origins_.empty()) bias_origins_ = comparison_.Origins();
  sensor_biases_.resize(comparison_.num_sensors());
  comparison_.GetBiases(bias_origins_, &sensor_biases_);
  RemoveBiases(sensor_biases_, &sensor_measurements_);
  SortByTime();
}

// Compares the last fit with the measurements that it did not know.
void TrackFit::ObservePredictionErrors() {
  if (trajectory_.control_points_m.empty()) return;  // nothing was predicted
  for (const Measurement& m : measurements_) {
    if (m.time_ns <= trajectory_.end_ns()) continue;
    prediction_scale_.Observe({m.time_ns, m.position_m - trajectory_.At(m.time_ns).position_m,
                               trajectory_.CovarianceAt(m.time_ns),
                               Square(trajectory_.scales.noise) * m.covariance_m2});
  }
}

// Insertion sort: nearly sorted, except for plots of one frame or of several sensors; does not
// allocate.
void TrackFit::SortByTime() {
  const auto first = sensor_measurements_.begin();
  for (auto at = first; at != sensor_measurements_.end(); ++at) {
    const auto place = std::upper_bound(first, at, *at, IsEarlier);
    const auto plot_ref = plot_refs_.begin() + (at - first);
    std::rotate(plot_refs_.begin() + (place - first), plot_ref, std::next(plot_ref));
    std::rotate(place, at, std::next(at));
  }
}

// True if a measurement newer than the scales is an outlier. With the scales of a hover, a
// departing target is one.
bool TrackFit::IsNewestOutlier() const {
  for (std::size_t i = measurements_.size(); i > 0; --i) {
    if (measurements_[i - 1].time_ns <= *scales_ns_) return false;
    if (IsOutlier(i - 1)) return true;
  }
  return false;
}

bool TrackFit::IsInlier(const Plot& plot) const {
  for (std::size_t i = 0; i < plot_refs_.size(); ++i) {
    if (plot_refs_[i].frame == plot.frame && plot_refs_[i].position_m == plot.position_m) {
      return !IsOutlier(i);
    }
  }
  return false;
}

std::vector<Measurement> TrackFit::InlierMeasurements() const {
  std::vector<Measurement> fitted;
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    if (!IsOutlier(i)) fitted.push_back(measurements_[i]);
  }
  return fitted;
}

int TrackFit::ReturnsBetween(TimeNs from_ns, TimeNs to_ns) const {
  int sum = 0;
  for (const PlotRef& one : plot_refs_) {
    if (one.stamp_ns >= from_ns && one.stamp_ns < to_ns) sum += one.num_returns;
  }
  return sum;
}

}  // namespace unlidar
