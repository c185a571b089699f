#include "collection/frame_length.hpp"

namespace unlidar {
namespace {

// Most LiDARs emit 10 frames per second.
constexpr double kRevolutionS = 0.1;

}  // namespace

void FrameLength::Add(const Streak& streak, const BodySigmas& body) {
  if (!IsAmbiguous(streak.length_s)) return;
  // The stamp lies at the same fraction of the frame for either duration.
  time_bias_s_ = streak.stamp_s * (1.0 - kRevolutionS / streak.length_s);
  const Eigen::Vector3d along = streak.velocity_mps.stableNormalized();
  const double square_sum_m2 = along.dot(streak.scatter_m2 * along);
  const double beam_m = kBeamSigmaRad * streak.ray_m.norm();
  const double body_m2 = along.dot(BodyCovarianceM2(body, streak.ray_m) * along) + beam_m * beam_m;
  const auto log_likelihood = [&](double streak_s) {
    const double variance_m2 =
        body_m2 + streak.velocity_mps.squaredNorm() * streak_s * streak_s / 12.0;
    return -0.5 *
           ((streak.num_returns - 1.0) * std::log(variance_m2) + square_sum_m2 / variance_m2);
  };
  log_short_ += log_likelihood(kRevolutionS) - log_likelihood(streak.length_s);
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
