#include "trajectory/agility.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "base/square.hpp"

namespace unlidar {
namespace {

// An eighth to four times the sigma_a of the whole flight, in half octaves.
constexpr int kLevels = 11;
constexpr int kLowestLevel = -6;
constexpr double kStay_s = 0.5;
constexpr std::array<double, 3> kSpreads = {0.25, 0.5, 1.0};  // of the logarithm of sigma_a

using Levels = Eigen::Array<double, kLevels, 1>;

Levels LogVariances() {
  return Levels::LinSpaced(kLowestLevel, kLowestLevel + kLevels - 1) * std::log(2.0);
}

// Expected squares of what drives the acceleration in an interval, in units of the variance of the
// whole flight.
struct Jerks {
  double fitted = 0.0;
  double measured = 0.0;  // degrees of freedom, of 3, that the measurements determine
};

// Of the two rows of an interval.
Jerks JerksOf(const SplineModel& model, std::size_t interval, const SplineFit& fit,
              const std::vector<std::array<Eigen::Matrix3d, 4>>& covariances,
              double acceleration_mps2) {
  double squares = 0.0;
  double unknown = 0.0;
  for (const std::size_t i : {2 * interval + 1, 2 * interval + 2}) {
    const SplineRow& row = model.smoothness[i];
    squares += Residual(row, fit.control_points_m).squaredNorm();
    double variance = 0.0;
    for (int a = 0; a < 4; ++a) {
      for (int b = a; b < 4; ++b) {
        const auto first = static_cast<std::size_t>(row.first + a);
        variance += (a == b ? 1.0 : 2.0) * row.basis[a] * row.basis[b] *
                    covariances[first][static_cast<std::size_t>(b - a)].trace();
      }
    }
    unknown += variance * Square(row.sqrt_information(0, 0));
  }
  return {squares * Square(model.agility[interval] / acceleration_mps2),
          std::clamp(3.0 - unknown / Square(acceleration_mps2), 0.0, 3.0)};
}

// What a hidden Markov chain says of the variances (intervals): their means, and its evidence.
struct ChainResult {
  std::vector<double> variances;
  double log_evidence = 0.0;
};

// likelihoods: (intervals). stays: (intervals) probability to be still at the level of the one
// before.
ChainResult FollowLevels(const std::vector<Levels>& likelihoods, const std::vector<double>& stays,
                         double spread) {
  Levels prior = (-0.5 * (0.5 * LogVariances() / spread).square()).exp();
  prior /= prior.sum();
  const std::size_t n = likelihoods.size();
  ChainResult result;
  std::vector<Levels> forward(n);
  Levels expected = prior;
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0) expected = stays[i] * forward[i - 1] + (1.0 - stays[i]) * prior;
    forward[i] = likelihoods[i] * expected;
    result.log_evidence += std::log(forward[i].sum());
    forward[i] /= forward[i].sum();
  }
  result.variances.resize(n);
  Levels backward = Levels::Ones();
  const Levels variances = LogVariances().exp();
  for (std::size_t i = n; i-- > 0;) {
    const Levels posterior = forward[i] * backward;
    result.variances[i] = (posterior * variances).sum() / posterior.sum();
    const Levels later = likelihoods[i] * backward;
    backward = stays[i] * later + (1.0 - stays[i]) * (prior * later).sum();
    backward /= backward.sum();
  }
  return result;
}

}  // namespace

void AdaptAgility(const SplineFit& fit, const TrajectoryScales& scales, SplineModel& model) {
  const auto covariances = ControlPointCovariances(model, fit.weights, scales);
  const Levels log_variances = LogVariances();
  const std::size_t n = model.agility.size();
  std::vector<Levels> likelihoods(n);
  std::vector<double> stays(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Jerks jerks = JerksOf(model, i, fit, covariances, scales.acceleration_mps2);
    const Levels log_likelihood =
        -0.5 * (jerks.measured * log_variances + jerks.fitted * (-log_variances).exp());
    likelihoods[i] = (log_likelihood - log_likelihood.maxCoeff()).exp();
    const double step_s = 0.5 * (model.knots_s[i + 4] - model.knots_s[i + 2]);
    stays[i] = std::exp(-step_s / kStay_s);
  }
  std::array<ChainResult, kSpreads.size()> chains;
  double best = 0.0;
  for (std::size_t s = 0; s < chains.size(); ++s) {
    chains[s] = FollowLevels(likelihoods, stays, kSpreads[s]);
    best = s == 0 ? chains[s].log_evidence : std::max(best, chains[s].log_evidence);
  }
  std::vector<double> variances(n, 0.0);
  double sum = 0.0;
  for (const ChainResult& chain : chains) {
    const double share = std::exp(chain.log_evidence - best);
    sum += share;
    for (std::size_t i = 0; i < n; ++i) variances[i] += share * chain.variances[i];
  }
  for (std::size_t i = 0; i < n; ++i) {
    model.agility[i] = std::sqrt(variances[i] / sum);
    for (const std::size_t row : {2 * i + 1, 2 * i + 2}) {
      model.smoothness[row].sqrt_information = Eigen::Matrix3d::Identity() / model.agility[i];
    }
  }
}

}  // namespace unlidar
