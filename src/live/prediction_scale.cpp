#include "live/prediction_scale.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "base/maths.hpp"
#include "base/recording.hpp"

namespace unlidar {
namespace {

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

}  // namespace unlidar
