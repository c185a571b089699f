#include "trajectory/kind.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/maths.hpp"

namespace unlidar {
namespace {

using Styles = StyleLikelihoods;

template <std::size_t kSize>
using Shares = std::array<double, kSize>;

// Values that a flight keeps, on grids.
constexpr Shares<Styles::kNumCruises> kCruisesMps = {1.5, 2.5, 4.0, 6.0, 9.0, 13.0, 18.0, 25.0};
constexpr Shares<Styles::kNumHovers> kHoverShares = {0.02, 0.3, 0.9};
// Standard deviation of the speed over the cruise speed; the same for both classes, because the
// acceleration along the velocity says it already.
constexpr Shares<Styles::kNumVariations> kVariations = {0.12, 0.25, 0.5};
constexpr Shares<Styles::kNumVariations> kVariationShares = {0.3, 0.4, 0.3};
constexpr Shares<Styles::kNumClimbs> kClimbsMps = {0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2};  // RMS
constexpr Shares<Styles::kNumLevels> kLevelsMps2 = {0.3, 0.6, 1.2, 2.5, 5.0, 10.0};      // RMS
// Share of the squared acceleration that is along the velocity.
constexpr Shares<Styles::kNumDirections> kAlongShares = {0.05, 0.2, 0.5, 0.8};

// From this index of a level on a flight manoeuvres.
constexpr std::size_t kManoeuvringLevel = 3;

// How often flights that keep steady, and those that manoeuvre, have which style.
struct StyleShares {
  Shares<Styles::kNumClimbs> climbs;
  Shares<Styles::kNumDirections> directions;
};

// How often flights of a class have which style; docs/kinds.md has the sources.
struct FlightClass {
  Shares<Styles::kNumCruises> cruises;
  Shares<Styles::kNumHovers> hovers;
  Shares<Styles::kNumLevels> levels;
  StyleShares steady;
  StyleShares manoeuvring;
};

// Multicopters hover, creep and fly at up to 20 m/s; their controller holds the height to
// decimetres whatever they do; their thrust points anywhere, with a tilt of at most 25 to 35
// degrees (4.6 to 6.9 m/s^2) for camera drones and of more for racing ones.
constexpr StyleShares kDroneShares = {{0.2, 0.2, 0.15, 0.15, 0.12, 0.1, 0.08},
                                      {0.2, 0.25, 0.35, 0.2}};
constexpr FlightClass kDrone = {{0.14, 0.14, 0.15, 0.15, 0.16, 0.14, 0.09, 0.03},
                                {0.5, 0.3, 0.2},
                                {0.22, 0.24, 0.22, 0.18, 0.1, 0.04},
                                kDroneShares,
                                kDroneShares};

// Birds need air speed, hang in the wind at times, and bank for up to 2 g. Across their way lift
// accelerates them; along it only their power and drag do, or an exchange with height: at 8 m/s a
// surplus of 2 m/s of climb is worth 2.5 m/s^2.
constexpr FlightClass kBirdLike = {
    {0.005, 0.02, 0.08, 0.18, 0.27, 0.26, 0.14, 0.045},
    {0.95, 0.04, 0.01},
    {0.15, 0.2, 0.22, 0.22, 0.16, 0.05},
    {{0.03, 0.1, 0.22, 0.3, 0.2, 0.12, 0.03}, {0.28, 0.3, 0.27, 0.15}},
    {{0.005, 0.02, 0.1, 0.25, 0.33, 0.22, 0.075}, {0.5, 0.36, 0.12, 0.02}}};

// Independent seconds per second. Values of neighbouring seconds correlate by about 0.5 even within
// one style, and n correlated values are worth n (1 - 0.5) / (1 + 0.5) independent ones.
constexpr double kIndependentShare = 1.0 / 3.0;

// Share of seconds in which a flight does anything, because no style is exact.
constexpr double kOutlierShare = 0.05;
constexpr double kOutlierSpeedMps = 10.0;
constexpr double kOutlierClimbMps = 3.0;
constexpr double kOutlierAccelerationMps2 = 10.0;

constexpr double kHoverSpreadMps = 0.3;  // along an axis: position hold within 0.1 to 0.5 m

// e^-x I_0(x): std::cyl_bessel_i overflows from 713 on.
double ScaledBessel0(double x) {
  constexpr double kFar = 50.0;
  if (x > kFar) return (1.0 + 0.125 / x) / std::sqrt(2.0 * M_PI * x);
  return std::exp(-x) * std::cyl_bessel_i(0.0, x);
}

// Density of a measured plane vector whose true length is `mean`, in any direction.
double RingDensity(double length, double mean, double variance) {
  return std::exp(-0.5 * Square(length - mean) / variance) / (2.0 * M_PI * variance) *
         ScaledBessel0(length * mean / variance);
}

double NormalDensity(double x, double variance) {
  return std::exp(-0.5 * x * x / variance) / std::sqrt(2.0 * M_PI * variance);
}

// Cauchy's densities in one dimension and two do not vanish for any value.
double CauchyDensity(double x, double scale_squared) {
  return std::sqrt(scale_squared) / (M_PI * (scale_squared + x * x));
}

double PlaneCauchyDensity(double length_squared, double scale_squared) {
  return std::sqrt(scale_squared) / (2.0 * M_PI * std::pow(scale_squared + length_squared, 1.5));
}

double LogOf(double density, double outlier_density) {
  return kIndependentShare *
         std::log((1.0 - kOutlierShare) * density + kOutlierShare * outlier_density);
}

template <std::size_t kSize>
double LogMean(const std::array<double, kSize>& logs, const Shares<kSize>& shares) {
  std::array<double, kSize> terms;
  for (std::size_t i = 0; i < kSize; ++i) terms[i] = logs[i] + std::log(shares[i]);
  return LogSum(terms);
}

template <class Logs>
double SpeedLog(const Logs& logs, const FlightClass& of) {
  Logs terms = logs;
  std::size_t i = 0;
  for (const double cruise : of.cruises) {
    for (const double hover : of.hovers) {
      for (const double variation : kVariationShares) {
        terms[i++] += std::log(cruise * hover * variation);
      }
    }
  }
  return LogSum(terms);
}

template <class Logs, class ClimbLogs>
double AccelerationLog(const Logs& logs, const FlightClass& of, const ClimbLogs& climb_logs) {
  const std::array<double, 2> of_climbs = {LogMean(climb_logs, of.steady.climbs),
                                           LogMean(climb_logs, of.manoeuvring.climbs)};
  Logs terms = logs;
  std::size_t i = 0;
  for (std::size_t level = 0; level < of.levels.size(); ++level) {
    const bool manoeuvres = level >= kManoeuvringLevel;
    for (const double direction : (manoeuvres ? of.manoeuvring : of.steady).directions) {
      terms[i++] += std::log(of.levels[level] * direction) + of_climbs[manoeuvres ? 1 : 0];
    }
  }
  return LogSum(terms);
}

constexpr double kHoverMps = 1.0;
constexpr double kKindSteps = 10'000.0;  // resolution of probabilities

// Flights of either class in the manner of the other, estimates on the safe side: drones with
// wings, and multicopters that are flown like them, through gates or with goggles; birds that hang
// in the wind for minutes. They bound what any flight can say.
constexpr double kBirdLikeDrones = 0.2;
constexpr double kDroneLikeBirds = 0.01;

// `log_ratio`: of the drones' own manner to the birds'.
Kind KindOf(double log_ratio) {
  const double drones_own = 1.0 / (1.0 + std::exp(-log_ratio));
  const double birds_own = 1.0 - drones_own;
  const double of_drones = (1.0 - kBirdLikeDrones) * drones_own + kBirdLikeDrones * birds_own;
  const double of_birds = (1.0 - kDroneLikeBirds) * birds_own + kDroneLikeBirds * drones_own;
  // Of drones and birds, equally many, these are drones where the flight is like this. Unknown is
  // the probability that the likelier of the two is wrong: a half where nothing is known.
  const double drone = of_drones / (of_drones + of_birds);
  const double known = std::max(drone, 1.0 - drone);
  const double drone_steps = std::round(kKindSteps * known * drone);
  const double bird_steps = std::round(kKindSteps * known * (1.0 - drone));
  return {drone_steps / kKindSteps, bird_steps / kKindSteps,
          (kKindSteps - drone_steps - bird_steps) / kKindSteps};
}

}  // namespace

void StyleLikelihoods::AddSpeed(double speed_mps, double variance) {
  const double hovering = RingDensity(speed_mps, 0.0, Square(kHoverSpreadMps) + variance);
  const double outlier = PlaneCauchyDensity(Square(speed_mps), Square(kOutlierSpeedMps) + variance);
  for (std::size_t c = 0; c < kNumCruises; ++c) {
    for (std::size_t v = 0; v < kNumVariations; ++v) {
      const double cruising = RingDensity(speed_mps, kCruisesMps[c],
                                          Square(kVariations[v] * kCruisesMps[c]) + variance);
      for (std::size_t h = 0; h < kNumHovers; ++h) {
        speed_logs_[(c * kNumHovers + h) * kNumVariations + v] +=
            LogOf((1.0 - kHoverShares[h]) * cruising + kHoverShares[h] * hovering, outlier);
      }
    }
  }
}

void StyleLikelihoods::AddClimb(double climb_mps, double variance) {
  const double outlier = CauchyDensity(climb_mps, Square(kOutlierClimbMps) + variance);
  for (std::size_t i = 0; i < kNumClimbs; ++i) {
    climb_logs_[i] += LogOf(NormalDensity(climb_mps, Square(kClimbsMps[i]) + variance), outlier);
  }
}

void StyleLikelihoods::AddAcceleration(double along_mps2, double across_mps2, double variance) {
  const double outlier = PlaneCauchyDensity(Square(along_mps2) + Square(across_mps2),
                                            Square(kOutlierAccelerationMps2) + variance);
  std::size_t i = 0;
  for (const double level_mps2 : kLevelsMps2) {
    for (const double along : kAlongShares) {
      const double density =
          NormalDensity(along_mps2, along * Square(level_mps2) + variance) *
          NormalDensity(across_mps2, (1.0 - along) * Square(level_mps2) + variance);
      acceleration_logs_[i++] += LogOf(density, outlier);
    }
  }
}

double StyleLikelihoods::LogRatio() const {
  const auto log_of = [&](const FlightClass& of) {
    return SpeedLog(speed_logs_, of) + AccelerationLog(acceleration_logs_, of, climb_logs_);
  };
  return log_of(kDrone) - log_of(kBirdLike);
}

std::array<double, kNumCues> StyleLikelihoods::LogRatios() const {
  const Logs<kNumClimbs> no_climbs = {};
  const Logs<kNumLevels* kNumDirections> no_accelerations = {};
  const auto ratio_of = [](const auto& log_of) { return log_of(kDrone) - log_of(kBirdLike); };
  return {ratio_of([&](const FlightClass& of) { return SpeedLog(speed_logs_, of); }),
          ratio_of([&](const FlightClass& of) {
            return AccelerationLog(no_accelerations, of, climb_logs_);
          }),
          ratio_of([&](const FlightClass& of) {
            return AccelerationLog(acceleration_logs_, of, no_climbs);
          })};
}

KindFilter::Instant KindFilter::InstantAt(const Trajectory& trajectory, TimeNs time_ns) {
  const Eigen::Matrix3d covariance_m2 = trajectory.CovarianceAt(time_ns);
  return {time_ns, trajectory.At(time_ns).position_m,
          std::max(0.0, 0.5 * (covariance_m2(0, 0) + covariance_m2(1, 1))),
          std::max(0.0, covariance_m2(2, 2))};
}

void KindFilter::Observe(const Trajectory& trajectory, TimeNs until_ns) {
  const TimeNs end_ns = std::min(until_ns, trajectory.end_ns());
  // The fit of a stream covers the last few seconds only.
  if (last_ && last_->time_ns < trajectory.begin_ns()) last_.reset();
  if (!last_) {
    before_.reset();
    last_ = InstantAt(trajectory, trajectory.begin_ns());
    if (seconds_ == 0.0) first_m_ = last_->position_m;
  }
  if (last_->time_ns + kNsPerSecond > end_ns) return;
  while (last_->time_ns + kNsPerSecond <= end_ns) {
    Update(InstantAt(trajectory, last_->time_ns + kNsPerSecond));
  }
  kind_ = KindOf(styles_.LogRatio());
}

// Steps are of one second, so that differences of positions are velocities.
void KindFilter::Update(const Instant& next) {
  const Eigen::Vector3d velocity_mps = next.position_m - last_->position_m;
  const double speed_mps = velocity_mps.head<2>().norm();
  styles_.AddSpeed(speed_mps, next.across_m2 + last_->across_m2);
  styles_.AddClimb(velocity_mps.z(), next.height_m2 + last_->height_m2);
  if (before_) {
    const Eigen::Vector3d earlier_mps = last_->position_m - before_->position_m;
    const Eigen::Vector2d mean_mps = 0.5 * (velocity_mps + earlier_mps).head<2>();
    const Eigen::Vector2d change_mps2 = (velocity_mps - earlier_mps).head<2>();
    Eigen::Vector2d along = Eigen::Vector2d::UnitX();  // of a target that stands still, any
    if (mean_mps.norm() > 0.0) along = mean_mps.normalized();
    const double turn_mps2 = along.x() * change_mps2.y() - along.y() * change_mps2.x();
    styles_.AddAcceleration(along.dot(change_mps2), turn_mps2,
                            before_->across_m2 + 4.0 * last_->across_m2 + next.across_m2);
    turn_sum_ += Square(turn_mps2);
    turns_ += 1.0;
  }
  const double step_m = velocity_mps.norm();
  if (speed_mps < kHoverMps) {
    hover_s_ += 1.0;
    hover_sum_m2_ += Square(step_m);
  }
  seconds_ += 1.0;
  speed_sum_mps_ += speed_mps;
  climb_sum_ += Square(velocity_mps.z());
  path_length_m_ += step_m;
  before_ = std::exchange(last_, next);
}

FlightStatistics KindFilter::Describe() const {
  FlightStatistics character;
  character.kind = kind_;
  character.log_ratios = styles_.LogRatios();
  if (seconds_ == 0.0) return character;
  character.seconds = seconds_;
  character.hover_share = hover_s_ / seconds_;
  character.wander_m = hover_s_ > 0.0 ? std::sqrt(hover_sum_m2_ / hover_s_) : 0.0;
  character.speed_mps = speed_sum_mps_ / seconds_;
  character.climb_mps = std::sqrt(climb_sum_ / seconds_);
  character.turn_mps2 = turns_ > 0.0 ? std::sqrt(turn_sum_ / turns_) : 0.0;
  character.straightness =
      path_length_m_ > 0.0 ? (last_->position_m - first_m_).norm() / path_length_m_ : 0.0;
  return character;
}

}  // namespace unlidar
