#include "trajectory/agility.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "base/square.hpp"

namespace unlidar {
namespace {

constexpr int kLowestLevel = -6;
constexpr double kStay_s = 0.5;
constexpr std::array<double, 3> kSpreads = {0.25, 0.5, 1.0};  // of the logarithm of sigma_a

using Levels = AgilityMemory::Levels;

Levels LogVariances() {
  return Levels::LinSpaced(kLowestLevel, kLowestLevel + kAgilityLevels - 1) * std::log(2.0);
}

// Expected squares of what drives the acceleration in an interval, in units of the variance of the
// whole flight.
struct Jerks {
  double fitted = 0.0;
  double measured = 0.0;  // degrees of freedom, of 3, that the measurements determine
};

// Of the two rows of an interval.
Jerks JerksOf(const SplineModel& model, std::size_t interval, const SplineFit& fit,
              const TrajectoryScales& scales) {
  // Of the covariance of a control point with the one d after it.
  const auto trace = [&](std::size_t point, std::size_t d) {
    double sum = 0.0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      sum += fit.inverse[3 * point + axis][static_cast<Eigen::Index>(3 * d)];
    }
    return sum * Square(scales.noise);
  };
  double squares = 0.0;
  double unknown = 0.0;
  for (const std::size_t i : {2 * interval + 1, 2 * interval + 2}) {
    const SmoothnessRow& row = model.smoothness[i];
    squares += Residual(row, fit.control_points_m).squaredNorm();
    double variance = 0.0;
    for (int a = 0; a < 4; ++a) {
      for (int b = a; b < 4; ++b) {
        const auto first = static_cast<std::size_t>(row.first + a);
        variance += (a == b ? 1.0 : 2.0) * row.basis[a] * row.basis[b] *
                    trace(first, static_cast<std::size_t>(b - a));
      }
    }
    unknown += variance * Square(row.weight);
  }
  const double variance = Square(scales.acceleration_mps2);
  return {squares * Square(model.agility[interval]) / variance,
          std::clamp(3.0 - unknown / variance, 0.0, 3.0)};
}

// What a hidden Markov chain says of the variances (intervals): sets their means, and returns its
// log evidence.
double FollowLevels(AgilityMemory& memory, std::size_t which) {
  const std::vector<Levels>& likelihoods = memory.likelihoods;
  const std::vector<double>& stays = memory.stays;
  const double spread = kSpreads[which];
  Levels prior = (-0.5 * (0.5 * LogVariances() / spread).square()).exp();
  prior /= prior.sum();
  const std::size_t n = likelihoods.size();
  double log_evidence = 0.0;
  std::vector<Levels>& forward = memory.forward;
  forward.resize(n);
  Levels expected = prior;
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0) expected = stays[i] * forward[i - 1] + (1.0 - stays[i]) * prior;
    forward[i] = likelihoods[i] * expected;
    log_evidence += std::log(forward[i].sum());
    forward[i] /= forward[i].sum();
  }
  memory.variances[which].resize(n);
  Levels backward = Levels::Ones();
  const Levels variances = LogVariances().exp();
  for (std::size_t i = n; i-- > 0;) {
    const Levels posterior = forward[i] * backward;
    memory.variances[which][i] = (posterior * variances).sum() / posterior.sum();
    const Levels later = likelihoods[i] * backward;
    backward = stays[i] * later + (1.0 - stays[i]) * (prior * later).sum();
    backward /= backward.sum();
  }
  return log_evidence;
}

}  // namespace

void AdaptAgility(const SplineFit& fit, const TrajectoryScales& scales, AgilityMemory& memory,
                  SplineModel& model) {
  const Levels log_variances = LogVariances();
  const std::size_t n = model.agility.size();
  memory.likelihoods.resize(n);
  memory.stays.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Jerks jerks = JerksOf(model, i, fit, scales);
    const Levels log_likelihood =
        -0.5 * (jerks.measured * log_variances + jerks.fitted * (-log_variances).exp());
    memory.likelihoods[i] = (log_likelihood - log_likelihood.maxCoeff()).exp();
    const double step_s = 0.5 * (model.knots_s[i + 4] - model.knots_s[i + 2]);
    memory.stays[i] = std::exp(-step_s / kStay_s);
  }
  std::array<double, kSpreads.size()> shares;
  for (std::size_t s = 0; s < shares.size(); ++s) shares[s] = FollowLevels(memory, s);
  const double best = *std::max_element(shares.begin(), shares.end());
  double sum = 0.0;
  for (double& share : shares) {
    share = std::exp(share - best);
    sum += share;
  }
  for (std::size_t i = 0; i < n; ++i) {
    double variance = 0.0;
    for (std::size_t s = 0; s < shares.size(); ++s) variance += shares[s] * memory.variances[s][i];
    model.agility[i] = std::sqrt(variance / sum);
    for (const std::size_t row : {2 * i + 1, 2 * i + 2}) {
      model.smoothness[row].weight = 1.0 / model.agility[i];
    }
  }
}

}  // namespace unlidar
