#include "collection/body.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

constexpr double kHeightOfWidth = 0.5;

}  // namespace

Eigen::Matrix3d BodyCovarianceM2(const BodySigmas& body, const Eigen::Vector3d& ray_m) {
  const Eigen::Matrix3d axes = RayAxes(ray_m);
  const Eigen::Vector3d sigmas_m(body.depth_m, body.width_m, body.height_m);
  return axes * sigmas_m.cwiseAbs2().asDiagonal() * axes.transpose();
}

Eigen::Matrix3d ReturnCovarianceM2(const BodySigmas& body, const Eigen::Vector3d& ray_m) {
  const double beam_m = kBeamSigmaRad * ray_m.norm();
  return BodyCovarianceM2(body, ray_m) + beam_m * beam_m * Eigen::Matrix3d::Identity();
}

Eigen::Matrix3d MeasurementCovarianceM2(const BodySigmas& body, const Eigen::Vector3d& ray_m,
                                        const Eigen::Matrix3d& streak_m2, double num_returns) {
  return kCentreSigmaM * kCentreSigmaM * Eigen::Matrix3d::Identity() +
         (ReturnCovarianceM2(body, ray_m) + streak_m2) / num_returns;
}

double ElevationVarianceM2(double beam_step_m, double body_sigma_m) {
  return std::min(Square(beam_step_m) / 12.0, Square(kHeightOfWidth * body_sigma_m));
}

Eigen::Matrix3d StreakM2(const FrameInfo& frame, const Eigen::Vector3d& velocity_mps) {
  if (frame.is_timed) return Eigen::Matrix3d::Zero();
  return StreakM2(SecondsOf(frame.end_ns - frame.begin_ns), velocity_mps);
}

Eigen::Matrix3d StreakM2(double length_s, const Eigen::Vector3d& velocity_mps) {
  const Eigen::Vector3d along_m = velocity_mps * length_s;
  return along_m * along_m.transpose() / 12.0;
}

BodySpread::BodySpread(double sigma_m)
    : variance_m2_(sigma_m * sigma_m),
      sums_m2_(Eigen::Array3d::Constant(kBodyPriorReturns * variance_m2_)),
      weights_(Eigen::Array3d::Constant(kBodyPriorReturns)),
      count_(kBodyPriorReturns) {}

void BodySpread::Add(const Recording& recording, const FrameInfo& frame,
                     const Eigen::Vector3d& viewpoint_m, const std::vector<std::uint32_t>& returns,
                     const TrajectoryRow& expected) {
  const Eigen::Matrix3d axes = RayAxes(expected.position_m - viewpoint_m);
  const Eigen::Array3d streak_m2 =
      (axes.transpose() * StreakM2(frame, expected.velocity_mps) * axes).diagonal();
  const Eigen::Array3d weight =
      streak_m2.unaryExpr([&](double one_m2) { return BodyWeight(variance_m2_, one_m2); });
  const double has_streak = 1.0 - std::pow(weight.minCoeff(), 2);
  const Eigen::Vector3d across = axes.col(0).cross(expected.velocity_mps).stableNormalized();
  offsets_m_.clear();
  for (const std::uint32_t i : returns) {
    const double elapsed_s = SecondsOf(recording.times_ns[i] - expected.time_ns);
    const Eigen::Vector3d offset_m = recording.points_m[i].cast<double>() - expected.position_m -
                                     elapsed_s * expected.velocity_mps;
    offsets_m_.push_back(axes.transpose() * offset_m);
    sums_m2_ += weight * (offsets_m_.back().array().square() - streak_m2);
    weights_ += weight;
    across_m2_ += has_streak * std::pow(across.dot(offset_m), 2);
    count_ += 1.0;
  }
  if (!ShowsShape(variance_m2_, streak_m2[1])) return;
  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& one_m : offsets_m_) mean_m += one_m;
  mean_m /= static_cast<double>(offsets_m_.size());
  FacingSums sums;
  for (const Eigen::Vector3d& one_m : offsets_m_) sums.Add(one_m - mean_m);
  facing_side_.Add(sums);
}

BodySigmas BodySpread::Sigmas() const {
  const Eigen::Array3d sigmas_m = (sums_m2_ / weights_).max(across_m2_ / count_).sqrt();
  return {sigmas_m[0], sigmas_m[1], sigmas_m[2]};
}

}  // namespace unlidar
