#include "trajectory/kind.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace unlidar {
namespace {

constexpr TimeNs kStepNs = 1'000'000'000;
constexpr double kHoverMps = 1.0;
constexpr double kKindSteps = 10'000.0;  // of probabilities

enum class Class { kDrone, kBirdLike, kUnknown };
constexpr std::size_t kNumClasses = 3;

// How often which value occurs: normal about a mean, but for a share of them that is normal about
// zero; with a spread of zero a density of 1 / (1 + |x| / mean), for signed values its square. Cut
// off where the grid ends. All in m/s, or m/s^2 for turns.
struct Law {
  double mean = 0.0;
  double spread = 0.0;      // standard deviation
  double step = 0.0;        // standard deviation of the change within a second
  double rest_share = 0.0;  // of values near zero,
  double rest_spread = 1.0;
};

struct FlightModel {
  Class kind;
  double share;  // among those of its class
  std::array<Law, kNumCues> laws;
};

// Ground speed, climb and turn of each model. docs/kinds.md says more of the sources. Speeds are
// over the ground: their spread includes 3 m/s of wind. What no source tells is an estimate.
constexpr Law kBroadSpeed = {1.0, 0.0, 5.0};  // as likely in each ratio of speeds
constexpr Law kBroadClimb = {1.0, 0.0, 3.0};
constexpr Law kBroadTurn = {2.0, 0.0, 4.0};
constexpr std::array<FlightModel, 8> kModels = {{
    // A drone on a mission, as steady as a bird. Data sheets of camera drones: they hold their
    // place within 0.1 to 0.5 m, fly at up to 15 to 21 m/s, climb at up to 8 and sink at up to 6.
    {Class::kDrone, 0.5, {{{0.0, 8.0, 1.0, 0.35, 0.4}, {0.0, 1.5, 0.5}, {0.0, 1.0, 0.7}}}},
    // The same flown by hand: it brakes, turns and climbs within seconds.
    {Class::kDrone, 0.3, {{{0.0, 8.0, 2.5, 0.35, 0.4}, {0.0, 2.0, 1.2}, {0.0, 2.0, 2.0}}}},
    // A racing drone: 8 m/s through gates (Foehn et al. 2020), 14 m/s in fast races, several g.
    {Class::kDrone, 0.2, {{{10.0, 6.0, 5.0, 0.05, 0.4}, {0.0, 3.0, 3.0}, {0.0, 8.0, 6.0}}}},
    // A bird that flaps somewhere: 8 to 23 m/s (Alerstam et al. 2007), sustained climbs of 0.3 to
    // 1.6 m/s (Hedenstroem & Alerstam 1992).
    {Class::kBirdLike, 0.4, {{{13.0, 4.0, 1.0}, {0.0, 1.0, 0.5}, {0.0, 1.0, 0.7}}}},
    // A bird that turns, in a flock, at play or chased: banks for up to 2 g (Usherwood et al.
    // 2011).
    {Class::kBirdLike, 0.25, {{{12.0, 4.0, 2.0}, {0.0, 1.8, 1.2}, {0.0, 4.0, 2.5}}}},
    // A gull or raptor that circles or hangs in the wind: the slow ones of Alerstam et al.
    {Class::kBirdLike, 0.15, {{{8.0, 4.0, 1.5}, {0.0, 1.5, 0.7}, {0.0, 3.0, 1.0}}}},
    // A bat that hunts: 6.7 and 7.7 m/s in the open (Salcedo et al. 1995), less near trees.
    {Class::kBirdLike, 0.2, {{{6.0, 2.0, 1.5}, {0.0, 1.2, 1.0}, {0.0, 4.0, 3.0}}}},
    // Anything: no value is preferred, and none is kept.
    {Class::kUnknown, 1.0, {{kBroadSpeed, kBroadClimb, kBroadTurn}}},
}};
constexpr std::array<Law, kNumCues> kBroad = {kBroadSpeed, kBroadClimb, kBroadTurn};

// No model is the whole truth: so much of every law is the broad one.
constexpr double kOtherShare = 0.02;

// So often a second a value is drawn anew, the others are those of before with a change. It is the
// same for all, so that how long something is kept up says little.
constexpr double kRedraw = 0.1;

double Square(double x) { return x * x; }

double Bell(double x, double sigma) { return std::exp(-0.5 * Square(x / sigma)) / sigma; }

struct Grid {
  std::vector<double> values;
  std::vector<double> widths;
};

// Finer near zero, where drones hover.
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

void Normalise(std::vector<double>& shares) {
  const double sum = std::accumulate(shares.begin(), shares.end(), 0.0);
  for (double& share : shares) share /= sum;
}

// Shares of the values of a grid.
std::vector<double> SharesOf(const Law& law, Cue cue) {
  const Grid& grid = GridOf(cue);
  const auto shares_of = [&](const auto& density) {
    std::vector<double> shares(grid.values.size());
    for (std::size_t i = 0; i < shares.size(); ++i) {
      shares[i] = grid.widths[i] * density(grid.values[i]);
    }
    Normalise(shares);
    return shares;
  };
  if (law.spread == 0.0) {
    const double power = cue == Cue::kSpeed ? 1.0 : 2.0;
    return shares_of([&](double x) { return std::pow(1.0 + std::abs(x) / law.mean, -power); });
  }
  const std::vector<double> moving =
      shares_of([&](double x) { return Bell(x - law.mean, law.spread); });
  const std::vector<double> resting = shares_of([&](double x) { return Bell(x, law.rest_spread); });
  std::vector<double> shares(moving.size());
  for (std::size_t i = 0; i < shares.size(); ++i) {
    shares[i] = (1.0 - law.rest_share) * moving[i] + law.rest_share * resting[i];
  }
  return shares;
}

// A law on its grid.
struct Chain {
  std::vector<double> shares;
  std::vector<std::vector<double>> steps;  // from each value to each
};

Chain MakeChain(const Law& law, Cue cue) {
  Chain chain;
  chain.shares = SharesOf(law, cue);
  const std::vector<double> broad = SharesOf(kBroad[static_cast<std::size_t>(cue)], cue);
  for (std::size_t i = 0; i < broad.size(); ++i) {
    chain.shares[i] = (1.0 - kOtherShare) * chain.shares[i] + kOtherShare * broad[i];
  }
  const Grid& grid = GridOf(cue);
  for (const double from : grid.values) {
    std::vector<double> step(grid.values.size());
    for (std::size_t j = 0; j < step.size(); ++j) {
      step[j] = grid.widths[j] * Bell(grid.values[j] - from, law.step);
    }
    Normalise(step);
    for (std::size_t j = 0; j < step.size(); ++j) {
      step[j] = (1.0 - kRedraw) * step[j] + kRedraw * chain.shares[j];
    }
    chain.steps.push_back(std::move(step));
  }
  return chain;
}

const std::array<Chain, kNumCues>& ChainsOf(std::size_t model) {
  static const std::vector<std::array<Chain, kNumCues>> kChains = [] {
    std::vector<std::array<Chain, kNumCues>> chains(kModels.size());
    for (std::size_t m = 0; m < kModels.size(); ++m) {
      for (std::size_t c = 0; c < kNumCues; ++c) {
        chains[m][c] = MakeChain(kModels[m].laws[c], static_cast<Cue>(c));
      }
    }
    return chains;
  }();
  return kChains[model];
}

// Variance of a value within its step of the grid, and of its measurement.
double VarianceAt(const Grid& grid, std::size_t i, double variance) {
  return variance + Square(grid.widths[i]) / 12.0;
}

// e^-x I_0(x): std::cyl_bessel_i leaves the range of a double from 713 on.
double ScaledBessel0(double x) {
  constexpr double kFar = 50.0;
  if (x > kFar) return (1.0 + 0.125 / x) / std::sqrt(2.0 * M_PI * x);
  return std::exp(-x) * std::cyl_bessel_i(0.0, x);
}

// Rice's law: how likely the length of a vector in the plane is measured like this, for each true
// one. What is the same for all of them is left out.
std::vector<double> LikelihoodsOfSpeed(double speed_mps, double variance) {
  const Grid& grid = GridOf(Cue::kSpeed);
  const double measured_mps = std::min(speed_mps, grid.values.back());  // what is beyond is there
  std::vector<double> likelihoods(grid.values.size());
  for (std::size_t i = 0; i < likelihoods.size(); ++i) {
    const double v = VarianceAt(grid, i, variance);
    likelihoods[i] = std::exp(-0.5 * Square(measured_mps - grid.values[i]) / v) / v *
                     ScaledBessel0(measured_mps * grid.values[i] / v);
  }
  return likelihoods;
}

std::vector<double> LikelihoodsOf(Cue cue, double measured, double variance) {
  const Grid& grid = GridOf(cue);
  const double x = std::clamp(measured, grid.values.front(), grid.values.back());
  std::vector<double> likelihoods(grid.values.size());
  for (std::size_t i = 0; i < likelihoods.size(); ++i) {
    likelihoods[i] = Bell(x - grid.values[i], std::sqrt(VarianceAt(grid, i, variance)));
  }
  return likelihoods;
}

double LogSum(const std::vector<double>& logs) {
  const double most = *std::max_element(logs.begin(), logs.end());
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(log - most);
  return most + std::log(sum);
}

// (classes) Log likelihood, given that of each model.
template <class LogLikelihood>
std::array<double, kNumClasses> LogLikelihoodsOfClasses(const LogLikelihood& of_model) {
  std::array<double, kNumClasses> result = {};
  for (std::size_t c = 0; c < kNumClasses; ++c) {
    std::vector<double> logs;
    for (std::size_t m = 0; m < kModels.size(); ++m) {
      if (kModels[m].kind != static_cast<Class>(c)) continue;
      logs.push_back(std::log(kModels[m].share) + of_model(m));
    }
    result[c] = LogSum(logs);
  }
  return result;
}

}  // namespace

KindFilter::KindFilter() : beliefs_(kModels.size()) {
  for (std::size_t m = 0; m < beliefs_.size(); ++m) {
    for (std::size_t c = 0; c < kNumCues; ++c) beliefs_[m][c].shares = ChainsOf(m)[c].shares;
  }
}

KindFilter::Instant KindFilter::InstantAt(const Trajectory& trajectory, TimeNs time_ns) {
  const Eigen::Matrix3d covariance_m2 = trajectory.CovarianceAt(time_ns);
  return {time_ns, trajectory.At(time_ns).position_m,
          std::max(0.0, 0.5 * (covariance_m2(0, 0) + covariance_m2(1, 1))),
          std::max(0.0, covariance_m2(2, 2))};
}

void KindFilter::Observe(const Trajectory& trajectory, TimeNs until_ns) {
  const TimeNs end_ns = std::min(until_ns, trajectory.end_ns());
  // The fit of a stream looks back for some seconds only.
  if (last_ && last_->time_ns < trajectory.begin_ns()) last_.reset();
  if (!last_) {
    before_.reset();
    last_ = InstantAt(trajectory, trajectory.begin_ns());
    if (seconds_ == 0.0) first_m_ = last_->position_m;
  }
  while (last_->time_ns + kStepNs <= end_ns) {
    Judge(InstantAt(trajectory, last_->time_ns + kStepNs));
  }
}

void KindFilter::Judge(const Instant& next) {
  constexpr double kStepS = static_cast<double>(kStepNs) * kSecondsPerNs;
  const Eigen::Vector3d velocity_mps = (next.position_m - last_->position_m) / kStepS;
  const double speed_mps = velocity_mps.head<2>().norm();
  Take(Cue::kSpeed,
       LikelihoodsOfSpeed(speed_mps, (next.across_m2 + last_->across_m2) / Square(kStepS)));
  Take(Cue::kClimb, LikelihoodsOf(Cue::kClimb, velocity_mps.z(),
                                  (next.height_m2 + last_->height_m2) / Square(kStepS)));
  if (before_) {
    const Eigen::Vector3d earlier_mps = (last_->position_m - before_->position_m) / kStepS;
    const Eigen::Vector2d along_mps = (velocity_mps + earlier_mps).head<2>();
    const double cross = earlier_mps.x() * velocity_mps.y() - earlier_mps.y() * velocity_mps.x();
    // The change of the velocity across its mean; of what stands still there is none.
    const double turn_mps2 = along_mps.norm() > 0.0 ? 2.0 * cross / along_mps.norm() / kStepS : 0.0;
    Take(Cue::kTurn, LikelihoodsOf(Cue::kTurn, turn_mps2,
                                   (before_->across_m2 + 4.0 * last_->across_m2 + next.across_m2) /
                                       Square(Square(kStepS))));
    turn_sum_ += Square(turn_mps2);
    turns_ += 1.0;
  }
  const double way_m = velocity_mps.norm() * kStepS;
  if (speed_mps < kHoverMps) {
    hover_s_ += kStepS;
    hover_sum_m2_ += Square(way_m);
  }
  seconds_ += kStepS;
  speed_sum_mps_ += speed_mps * kStepS;
  climb_sum_ += Square(velocity_mps.z()) * kStepS;
  way_m_ += way_m;
  before_ = std::exchange(last_, next);
}

void KindFilter::Take(Cue cue, const std::vector<double>& likelihoods) {
  const auto c = static_cast<std::size_t>(cue);
  const double most = *std::max_element(likelihoods.begin(), likelihoods.end());
  for (std::size_t m = 0; m < beliefs_.size(); ++m) {
    const Chain& chain = ChainsOf(m)[c];
    Belief& belief = beliefs_[m][c];
    std::vector<double> next(belief.shares.size(), 0.0);
    for (std::size_t i = 0; i < next.size(); ++i) {
      for (std::size_t j = 0; j < next.size(); ++j) {
        next[j] += belief.shares[i] * chain.steps[i][j];
      }
    }
    for (std::size_t j = 0; j < next.size(); ++j) next[j] *= likelihoods[j] / most;
    belief.log_likelihood += std::log(std::accumulate(next.begin(), next.end(), 0.0));
    Normalise(next);
    belief.shares = std::move(next);
  }
}

Kind KindFilter::kind() const {
  std::array<double, kNumClasses> logs = LogLikelihoodsOfClasses([&](std::size_t m) {
    double log = 0.0;
    for (const Belief& belief : beliefs_[m]) log += belief.log_likelihood;
    return log;
  });
  logs[0] += std::log(kPriorKind.drone);
  logs[1] += std::log(kPriorKind.bird_like);
  logs[2] += std::log(kPriorKind.unknown);
  const double sum = LogSum({logs.begin(), logs.end()});
  const auto steps = [&](std::size_t c) {
    return std::round(kKindSteps * std::exp(logs[c] - sum));
  };
  // Down for the least of three: the other two may both have been rounded up.
  const double drone = steps(0);
  const double bird_like = std::min(steps(1), kKindSteps - drone);
  return {drone / kKindSteps, bird_like / kKindSteps,
          (kKindSteps - drone - bird_like) / kKindSteps};
}

FlightCharacter KindFilter::Describe() const {
  FlightCharacter character;
  character.kind = kind();
  for (std::size_t c = 0; c < kNumCues; ++c) {
    const std::array<double, kNumClasses> logs =
        LogLikelihoodsOfClasses([&](std::size_t m) { return beliefs_[m][c].log_likelihood; });
    character.log_ratios[c] = logs[0] - logs[1];
  }
  if (seconds_ == 0.0) return character;
  character.seconds = seconds_;
  character.hover_share = hover_s_ / seconds_;
  character.wander_m = hover_s_ > 0.0 ? std::sqrt(hover_sum_m2_ / hover_s_) : 0.0;
  character.speed_mps = speed_sum_mps_ / seconds_;
  character.climb_mps = std::sqrt(climb_sum_ / seconds_);
  character.turn_mps2 = turns_ > 0.0 ? std::sqrt(turn_sum_ / turns_) : 0.0;
  character.straightness = way_m_ > 0.0 ? (last_->position_m - first_m_).norm() / way_m_ : 0.0;
  return character;
}

EchoCharacter DescribeEcho(const Recording& recording, const std::vector<std::uint32_t>& returns,
                           const std::vector<Measurement>& measurements,
                           const Trajectory& trajectory) {
  EchoCharacter echo;
  for (const Measurement& m : measurements) {
    echo.echo_m2_per_s += m.support * (m.position_m - m.viewpoint_m).squaredNorm();
  }
  echo.echo_m2_per_s /= std::max(static_cast<double>(trajectory.duration_ns) * kSecondsPerNs, 1e-3);
  double sum_m2 = 0.0;
  const Eigen::Vector3d viewpoint_m = measurements.front().viewpoint_m;
  for (const std::uint32_t i : returns) {
    const Eigen::Vector3d centre_m = trajectory.At(recording.times_ns[i]).position_m;
    const Eigen::Vector3d off_m = recording.points_m[i].cast<double>() - centre_m;
    const Eigen::Vector3d ray = (centre_m - viewpoint_m).stableNormalized();
    sum_m2 += off_m.squaredNorm() - Square(off_m.dot(ray));
  }
  if (!returns.empty()) {
    echo.extent_m = std::sqrt(std::max(0.0, sum_m2) / static_cast<double>(returns.size()));
  }
  return echo;
}

}  // namespace unlidar
