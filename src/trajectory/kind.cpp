#include "trajectory/kind.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/maths.hpp"

namespace unlidar {
namespace {

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
