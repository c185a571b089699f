#include "collection/common_time_error.hpp"

#include <cmath>

#include "base/maths.hpp"

namespace unlidar {
namespace {

// Spread of the returns of a body at rest along one axis, body and noise together.
constexpr double kMinWidthM = 0.02;
constexpr double kMaxWidthM = 0.5;

}  // namespace

void CommonTimeError::Add(const Streak& streak) {
  if (FrameLength::IsAmbiguous(streak.length_s)) return;
  length_s_ = streak.length_s;
  const Eigen::Vector3d along = streak.velocity_mps.stableNormalized();
  const double square_sum_m2 = along.dot(streak.scatter_m2 * along);
  const double streak_m2 = streak.velocity_mps.squaredNorm() * Square(length_s_) / 12.0;
  const auto log_likelihood = [&](double variance_m2) {
    return -0.5 *
           ((streak.num_returns - 1.0) * std::log(variance_m2) + square_sum_m2 / variance_m2);
  };
  for (std::size_t i = 0; i < kNumWidths; ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(kNumWidths - 1);
    const double body_m2 = Square(kMinWidthM * std::pow(kMaxWidthM / kMinWidthM, share));
    log_streak_[i] += log_likelihood(body_m2 + streak_m2);
    log_instant_[i] += log_likelihood(body_m2);
  }
}

double CommonTimeError::VarianceS2() const {
  const double log_ratio = LogSum(log_streak_) - LogSum(log_instant_);
  return Square(length_s_) / 12.0 / (1.0 + std::exp(log_ratio));
}

}  // namespace unlidar
