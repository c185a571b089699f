#include "robust/collection/frame_length.hpp"

#include <cmath>

#include "robust/collection/collect.hpp"

namespace unlidar {
namespace {

// LiDARs give 5 to 20 frames a second, most of them 10.
constexpr double kTurnS = 0.1;
constexpr double kLongestTurnS = 0.2;

}  // namespace

void FrameLength::Add(const Recording& recording, const FrameInfo& frame,
                      const Eigen::Vector3d& viewpoint_m, const std::vector<std::uint32_t>& returns,
                      const Eigen::Vector3d& velocity_mps, const BodySigmas& body) {
  const double length_s = static_cast<double>(frame.end_ns - frame.begin_ns) * kSecondsPerNs;
  if (frame.is_timed || length_s <= kLongestTurnS) return;
  // The stamp stands at the same share of either length.
  const double stamp_s = static_cast<double>(frame.stamp_ns - frame.begin_ns) * kSecondsPerNs;
  late_s_ = (stamp_s - 0.5 * length_s) * (1.0 - kTurnS / length_s);

  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  const auto n = static_cast<double>(returns.size());
  for (const std::uint32_t i : returns) mean_m += recording.points_m[i].cast<double>() / n;
  const Eigen::Vector3d along = velocity_mps.stableNormalized();
  double square_sum_m2 = 0.0;
  for (const std::uint32_t i : returns) {
    square_sum_m2 += std::pow(along.dot(recording.points_m[i].cast<double>() - mean_m), 2);
  }
  const Eigen::Vector3d ray_m = mean_m - viewpoint_m;
  const double beam_m = kBeamSigmaRad * ray_m.norm();
  const double body_m2 = along.dot(BodyCovarianceM2(body, ray_m) * along) + beam_m * beam_m;
  const auto log_likelihood = [&](double streak_s) {
    const double variance_m2 = body_m2 + velocity_mps.squaredNorm() * streak_s * streak_s / 12.0;
    return -0.5 * ((n - 1.0) * std::log(variance_m2) + square_sum_m2 / variance_m2);
  };
  log_short_ += log_likelihood(kTurnS) - log_likelihood(length_s);
}

double FrameLength::LateS() const { return late_s_ / (1.0 + std::exp(-log_short_)); }

}  // namespace unlidar
