#include "trajectory/kind.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "base/square.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kStepNs = 1'000'000'000;
constexpr double kHoverMps = 1.0;
constexpr double kKindSteps = 10'000.0;  // resolution of probabilities

// Log of the sum of exp(log(i)) over the i < count for which is_in(i).
template <class IsIn, class Log>
double LogSum(std::size_t count, const IsIn& is_in, const Log& log) {
  double most = -std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < count; ++i) most = is_in(i) ? std::max(most, log(i)) : most;
  double sum = 0.0;
  for (std::size_t i = 0; i < count; ++i) sum += is_in(i) ? std::exp(log(i) - most) : 0.0;
  return most + std::log(sum);
}

// (classes) Log likelihood, given that of each model.
template <class LogLikelihood>
std::array<double, kNumFlightClasses> LogLikelihoodsOfClasses(const LogLikelihood& of_model) {
  std::array<double, kNumFlightClasses> result = {};
  const std::vector<FlightModel>& models = FlightModels();
  for (std::size_t c = 0; c < kNumFlightClasses; ++c) {
    result[c] = LogSum(
        models.size(),
        [&](std::size_t m) { return models[m].flight_class == static_cast<FlightClass>(c); },
        [&](std::size_t m) { return std::log(models[m].share) + of_model(m); });
  }
  return result;
}

}  // namespace

KindFilter::KindFilter() : posteriors_(FlightModels().size()) {
  for (std::size_t m = 0; m < posteriors_.size(); ++m) {
    for (std::size_t c = 0; c < kNumCues; ++c) {
      posteriors_[m][c].shares = FlightModels()[m].chains[c].shares;
    }
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
  // The fit of a stream covers the last few seconds only.
  if (last_ && last_->time_ns < trajectory.begin_ns()) last_.reset();
  if (!last_) {
    before_.reset();
    last_ = InstantAt(trajectory, trajectory.begin_ns());
    if (seconds_ == 0.0) first_m_ = last_->position_m;
  }
  while (last_->time_ns + kStepNs <= end_ns) {
    Update(InstantAt(trajectory, last_->time_ns + kStepNs));
  }
}

void KindFilter::Update(const Instant& next) {
  constexpr double kStepS = static_cast<double>(kStepNs) * kSecondsPerNs;
  const Eigen::Vector3d velocity_mps = (next.position_m - last_->position_m) / kStepS;
  const double speed_mps = velocity_mps.head<2>().norm();
  SetLikelihoodsOfSpeed(speed_mps, (next.across_m2 + last_->across_m2) / Square(kStepS),
                        &likelihoods_);
  UpdateCue(Cue::kSpeed);
  SetLikelihoodsOf(Cue::kClimb, velocity_mps.z(),
                   (next.height_m2 + last_->height_m2) / Square(kStepS), &likelihoods_);
  UpdateCue(Cue::kClimb);
  if (before_) {
    const Eigen::Vector3d earlier_mps = (last_->position_m - before_->position_m) / kStepS;
    const Eigen::Vector2d along_mps = (velocity_mps + earlier_mps).head<2>();
    const double cross = earlier_mps.x() * velocity_mps.y() - earlier_mps.y() * velocity_mps.x();
    // Change of the velocity across its mean; none for a target that stands still.
    const double turn_mps2 = along_mps.norm() > 0.0 ? 2.0 * cross / along_mps.norm() / kStepS : 0.0;
    SetLikelihoodsOf(
        Cue::kTurn, turn_mps2,
        (before_->across_m2 + 4.0 * last_->across_m2 + next.across_m2) / Square(Square(kStepS)),
        &likelihoods_);
    UpdateCue(Cue::kTurn);
    turn_sum_ += Square(turn_mps2);
    turns_ += 1.0;
  }
  const double step_m = velocity_mps.norm() * kStepS;
  if (speed_mps < kHoverMps) {
    hover_s_ += kStepS;
    hover_sum_m2_ += Square(step_m);
  }
  seconds_ += kStepS;
  speed_sum_mps_ += speed_mps * kStepS;
  climb_sum_ += Square(velocity_mps.z()) * kStepS;
  path_length_m_ += step_m;
  before_ = std::exchange(last_, next);
}

void KindFilter::UpdateCue(Cue cue) {
  const auto c = static_cast<std::size_t>(cue);
  const double most = *std::max_element(likelihoods_.begin(), likelihoods_.end());
  for (std::size_t m = 0; m < posteriors_.size(); ++m) {
    const MarkovChain& chain = FlightModels()[m].chains[c];
    CuePosterior& posterior = posteriors_[m][c];
    next_.assign(posterior.shares.size(), 0.0);
    for (std::size_t i = 0; i < next_.size(); ++i) {
      for (std::size_t j = 0; j < next_.size(); ++j) {
        next_[j] += posterior.shares[i] * chain.steps[i][j];
      }
    }
    for (std::size_t j = 0; j < next_.size(); ++j) next_[j] *= likelihoods_[j] / most;
    posterior.log_likelihood += std::log(std::accumulate(next_.begin(), next_.end(), 0.0));
    Normalise(&next_);
    posterior.shares = next_;
  }
}

Kind KindFilter::kind() const {
  std::array<double, kNumFlightClasses> logs = LogLikelihoodsOfClasses([&](std::size_t m) {
    double log = 0.0;
    for (const CuePosterior& posterior : posteriors_[m]) log += posterior.log_likelihood;
    return log;
  });
  logs[0] += std::log(kPriorKind.drone);
  logs[1] += std::log(kPriorKind.bird_like);
  logs[2] += std::log(kPriorKind.unknown);
  const double sum = LogSum(
      logs.size(), [](std::size_t) { return true; }, [&](std::size_t c) { return logs[c]; });
  const auto steps = [&](std::size_t c) {
    return std::round(kKindSteps * std::exp(logs[c] - sum));
  };
  // The smallest of three is rounded down, because the other two may both have been rounded up.
  const double drone = steps(0);
  const double bird_like = std::min(steps(1), kKindSteps - drone);
  return {drone / kKindSteps, bird_like / kKindSteps,
          (kKindSteps - drone - bird_like) / kKindSteps};
}

FlightStatistics KindFilter::Describe() const {
  FlightStatistics character;
  character.kind = kind();
  for (std::size_t c = 0; c < kNumCues; ++c) {
    const std::array<double, kNumFlightClasses> logs =
        LogLikelihoodsOfClasses([&](std::size_t m) { return posteriors_[m][c].log_likelihood; });
    character.log_ratios[c] = logs[0] - logs[1];
  }
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
