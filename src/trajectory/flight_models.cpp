#include "trajectory/flight_models.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "base/square.hpp"

namespace unlidar {
namespace {

// Distribution of the values of a cue: normal about a mean, except for a share that is normal about
// zero; with a spread of zero a density of 1 / (1 + |x| / mean), squared for signed values.
// Truncated at the end of the grid. All in m/s, or m/s^2 for turns.
struct CueDistribution {
  double mean = 0.0;
  double spread = 0.0;       // standard deviation
  double step = 0.0;         // standard deviation of the change within a second
  double hover_share = 0.0;  // share of values near zero
  double hover_spread = 1.0;
};

struct StatedModel {
  FlightClass flight_class;
  double share;  // among those of its class
  std::array<CueDistribution, kNumCues> distributions;
};

// Ground speed, climb and turn of each model; docs/kinds.md has the sources. Speeds are over
// ground: their spread includes 3 m/s of wind. Numbers without a source are estimates.
constexpr CueDistribution kBroadSpeed = {1.0, 0.0, 5.0};  // about uniform in log speed
constexpr CueDistribution kBroadClimb = {1.0, 0.0, 3.0};
constexpr CueDistribution kBroadTurn = {2.0, 0.0, 4.0};
constexpr std::array<StatedModel, 8> kModels = {{
    // A drone on a mission, as steady as a bird. Data sheets of camera drones: position hold
    // within 0.1 to 0.5 m, up to 15 to 21 m/s, climb at up to 8 and descent at up to 6 m/s.
    {FlightClass::kDrone, 0.5, {{{0.0, 8.0, 1.0, 0.35, 0.4}, {0.0, 1.5, 0.5}, {0.0, 1.0, 0.7}}}},
    // The same flown by hand: it brakes, turns and climbs within seconds.
    {FlightClass::kDrone, 0.3, {{{0.0, 8.0, 2.5, 0.35, 0.4}, {0.0, 2.0, 1.2}, {0.0, 2.0, 2.0}}}},
    // A racing drone: 8 m/s through gates (Foehn et al. 2020), 14 m/s in fast races, several g.
    {FlightClass::kDrone, 0.2, {{{10.0, 6.0, 5.0, 0.05, 0.4}, {0.0, 3.0, 3.0}, {0.0, 8.0, 6.0}}}},
    // A bird in flapping transit: 8 to 23 m/s (Alerstam et al. 2007), sustained climbs of 0.3 to
    // 1.6 m/s (Hedenstroem & Alerstam 1992).
    {FlightClass::kBirdLike, 0.4, {{{13.0, 4.0, 1.0}, {0.0, 1.0, 0.5}, {0.0, 1.0, 0.7}}}},
    // A bird that turns, in a flock, at play or chased: banks for up to 2 g (Usherwood et al.
    // 2011).
    {FlightClass::kBirdLike, 0.25, {{{12.0, 4.0, 2.0}, {0.0, 1.8, 1.2}, {0.0, 4.0, 2.5}}}},
    // A gull or raptor that circles or hangs in the wind: the slow ones of Alerstam et al.
    {FlightClass::kBirdLike, 0.15, {{{8.0, 4.0, 1.5}, {0.0, 1.5, 0.7}, {0.0, 3.0, 1.0}}}},
    // A bat that hunts: 6.7 and 7.7 m/s in the open (Salcedo et al. 1995), less near trees.
    {FlightClass::kBirdLike, 0.2, {{{6.0, 2.0, 1.5}, {0.0, 1.2, 1.0}, {0.0, 4.0, 3.0}}}},
    // Unknown: no value is preferred, and none persists.
    {FlightClass::kUnknown, 1.0, {{kBroadSpeed, kBroadClimb, kBroadTurn}}},
}};
constexpr std::array<CueDistribution, kNumCues> kBroad = {kBroadSpeed, kBroadClimb, kBroadTurn};

// Share of the broad distribution in every other one, because no model is exact.
constexpr double kBroadShare = 0.02;

// Redraws of a value per second; otherwise it follows the one before with a change. The same for
// all models, so that persistence is weak evidence.
constexpr double kRedrawRate = 0.1;

double GaussianDensity(double x, double sigma) {
  return std::exp(-0.5 * Square(x / sigma)) / sigma;
}

struct Grid {
  std::vector<double> values;
  std::vector<double> widths;
};

// Grid that is finer near zero, where drones hover.
Grid MakeGrid(bool is_signed) {
  std::vector<double> edges = {0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0};
  while (edges.back() < 30.0) edges.push_back(edges.back() + 1.0);
  if (is_signed) {
    for (std::size_t i = edges.size() - 1; i > 0; --i) edges.push_back(-edges[i]);
    std::sort(edges.begin(), edges.end());
  } else {
    edges.push_back(40.0);
  }
  Grid grid;
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    grid.values.push_back(0.5 * (edges[i] + edges[i + 1]));
    grid.widths.push_back(edges[i + 1] - edges[i]);
  }
  return grid;
}

const Grid& GridOf(Cue cue) {
  static const Grid kSpeeds = MakeGrid(false);
  static const Grid kSigned = MakeGrid(true);
  return cue == Cue::kSpeed ? kSpeeds : kSigned;
}

// Returns the shares of the values of a grid.
std::vector<double> SharesOf(const CueDistribution& distribution, Cue cue) {
  const Grid& grid = GridOf(cue);
  const auto shares_of = [&](const auto& density) {
    std::vector<double> shares(grid.values.size());
    for (std::size_t i = 0; i < shares.size(); ++i) {
      shares[i] = grid.widths[i] * density(grid.values[i]);
    }
    Normalise(&shares);
    return shares;
  };
  if (distribution.spread == 0.0) {
    const double power = cue == Cue::kSpeed ? 1.0 : 2.0;
    return shares_of(
        [&](double x) { return std::pow(1.0 + std::abs(x) / distribution.mean, -power); });
  }
  const std::vector<double> moving = shares_of(
      [&](double x) { return GaussianDensity(x - distribution.mean, distribution.spread); });
  const std::vector<double> hovering =
      shares_of([&](double x) { return GaussianDensity(x, distribution.hover_spread); });
  std::vector<double> shares(moving.size());
  for (std::size_t i = 0; i < shares.size(); ++i) {
    shares[i] =
        (1.0 - distribution.hover_share) * moving[i] + distribution.hover_share * hovering[i];
  }
  return shares;
}

MarkovChain MakeMarkovChain(const CueDistribution& distribution, Cue cue) {
  MarkovChain chain;
  chain.shares = SharesOf(distribution, cue);
  const std::vector<double> broad = SharesOf(kBroad[static_cast<std::size_t>(cue)], cue);
  for (std::size_t i = 0; i < broad.size(); ++i) {
    chain.shares[i] = (1.0 - kBroadShare) * chain.shares[i] + kBroadShare * broad[i];
  }
  const Grid& grid = GridOf(cue);
  for (const double from : grid.values) {
    std::vector<double> step(grid.values.size());
    for (std::size_t j = 0; j < step.size(); ++j) {
      step[j] = grid.widths[j] * GaussianDensity(grid.values[j] - from, distribution.step);
    }
    Normalise(&step);
    for (std::size_t j = 0; j < step.size(); ++j) {
      step[j] = (1.0 - kRedrawRate) * step[j] + kRedrawRate * chain.shares[j];
    }
    chain.steps.push_back(std::move(step));
  }
  return chain;
}

// Returns the sum of the variances of the grid step and of the measurement.
double VarianceAt(const Grid& grid, std::size_t i, double variance) {
  return variance + Square(grid.widths[i]) / 12.0;
}

// e^-x I_0(x): std::cyl_bessel_i overflows from 713 on.
double ScaledBessel0(double x) {
  constexpr double kFar = 50.0;
  if (x > kFar) return (1.0 + 0.125 / x) / std::sqrt(2.0 * M_PI * x);
  return std::exp(-x) * std::cyl_bessel_i(0.0, x);
}

}  // namespace

void Normalise(std::vector<double>* shares) {
  const double sum = std::accumulate(shares->begin(), shares->end(), 0.0);
  for (double& share : *shares) share /= sum;
}

const std::vector<FlightModel>& FlightModels() {
  static const std::vector<FlightModel> kFlightModels = [] {
    std::vector<FlightModel> models;
    for (const StatedModel& stated : kModels) {
      FlightModel model{stated.flight_class, stated.share, {}};
      for (std::size_t c = 0; c < kNumCues; ++c) {
        model.chains[c] = MakeMarkovChain(stated.distributions[c], static_cast<Cue>(c));
      }
      models.push_back(std::move(model));
    }
    return models;
  }();
  return kFlightModels;
}

// Rice's distribution: likelihood of the measured length of a plane vector given each true one, up
// to a common factor.
void SetLikelihoodsOfSpeed(double speed_mps, double variance, std::vector<double>* likelihoods) {
  const Grid& grid = GridOf(Cue::kSpeed);
  const double measured_mps = std::min(speed_mps, grid.values.back());  // clamped to the grid
  likelihoods->resize(grid.values.size());
  for (std::size_t i = 0; i < likelihoods->size(); ++i) {
    const double v = VarianceAt(grid, i, variance);
    (*likelihoods)[i] = std::exp(-0.5 * Square(measured_mps - grid.values[i]) / v) / v *
                        ScaledBessel0(measured_mps * grid.values[i] / v);
  }
}

void SetLikelihoodsOf(Cue cue, double measured, double variance, std::vector<double>* likelihoods) {
  const Grid& grid = GridOf(cue);
  const double x = std::clamp(measured, grid.values.front(), grid.values.back());
  likelihoods->resize(grid.values.size());
  for (std::size_t i = 0; i < likelihoods->size(); ++i) {
    (*likelihoods)[i] =
        GaussianDensity(x - grid.values[i], std::sqrt(VarianceAt(grid, i, variance)));
  }
}

}  // namespace unlidar
