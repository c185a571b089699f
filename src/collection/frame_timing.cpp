#include "collection/frame_timing.hpp"

#include "base/maths.hpp"

namespace unlidar {
namespace {

// Spread of the returns of a body at rest along one axis, body and noise together.
constexpr double kMinWidthM = 0.02;
constexpr double kMaxWidthM = 0.5;

}  // namespace

void FrameTiming::Add(const Streak& streak, const BodySigmas& body) {
  const Eigen::Vector3d along = streak.velocity_mps.stableNormalized();
  const double square_sum_m2 = along.dot(streak.scatter_m2 * along);
  const double square_mps2 = streak.velocity_mps.squaredNorm();
  const auto log_likelihood = [&](double variance_m2) {
    return -0.5 *
           ((streak.num_returns - 1.0) * std::log(variance_m2) + square_sum_m2 / variance_m2);
  };
  if (streak.length_s > kLongestFrameS) {
    // The stamp lies at the same fraction of the frame for either duration.
    time_bias_s_ = streak.stamp_s * (1.0 - kCommonFrameS / streak.length_s);
    const double beam_m = kBeamSigmaRad * streak.ray_m.norm();
    const double body_m2 =
        along.dot(BodyCovarianceM2(body, streak.ray_m) * along) + beam_m * beam_m;
    const auto variance_m2 = [&](double streak_s) {
      return body_m2 + square_mps2 * streak_s * streak_s / 12.0;
    };
    log_short_ +=
        log_likelihood(variance_m2(kCommonFrameS)) - log_likelihood(variance_m2(streak.length_s));
    return;
  }
  length_s_ = streak.length_s;
  const double streak_m2 = square_mps2 * Square(length_s_) / 12.0;
  for (std::size_t i = 0; i < kNumWidths; ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(kNumWidths - 1);
    const double body_m2 = Square(kMinWidthM * std::pow(kMaxWidthM / kMinWidthM, share));
    log_streak_[i] += log_likelihood(body_m2 + streak_m2);
    log_instant_[i] += log_likelihood(body_m2);
  }
}

double FrameTiming::VarianceS2() const {
  const double log_ratio = LogSum(log_streak_) - LogSum(log_instant_);
  const double short_probability = ShortProbability();
  return Square(length_s_) / 12.0 / (1.0 + std::exp(log_ratio)) +
         short_probability * (1.0 - short_probability) * Square(time_bias_s_) +
         Square(timed_sigma_s_);
}

Streak StreakOf(const Recording& recording, const FrameInfo& frame,
                const Eigen::Vector3d& viewpoint_m, const std::vector<std::uint32_t>& returns,
                const Eigen::Vector3d& velocity_mps) {
  Streak streak;
  streak.length_s = SecondsOf(frame.end_ns - frame.begin_ns);
  streak.stamp_s = SecondsOf(frame.stamp_ns - frame.begin_ns) - 0.5 * streak.length_s;
  streak.num_returns = static_cast<double>(returns.size());
  streak.velocity_mps = velocity_mps;
  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  for (const std::uint32_t i : returns) {
    mean_m += recording.points_m[i].cast<double>() / streak.num_returns;
  }
  for (const std::uint32_t i : returns) {
    const Eigen::Vector3d offset_m = recording.points_m[i].cast<double>() - mean_m;
    streak.scatter_m2 += offset_m * offset_m.transpose();
  }
  streak.ray_m = mean_m - viewpoint_m;
  return streak;
}

}  // namespace unlidar
