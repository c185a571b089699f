#include "trajectory/trajectory.hpp"

#include <cstddef>

#include "trajectory/banded.hpp"
#include "trajectory/bspline.hpp"
#include "trajectory/trajectory_fitter.hpp"

namespace unlidar {
namespace {

struct SplinePoint {
  std::size_t first = 0;
  Eigen::Vector4d basis = Eigen::Vector4d::Zero();
  Eigen::Vector4d slope = Eigen::Vector4d::Zero();
};

SplinePoint SplinePointAt(const Trajectory& trajectory, TimeNs time_ns) {
  const double time_s = static_cast<double>(time_ns - trajectory.origin_ns) * kSecondsPerNs;
  const int interval = IntervalAt(trajectory.knots_s, time_s);
  const auto first = static_cast<std::size_t>(interval);
  const double u_s = time_s - trajectory.knots_s[first + 3];
  const Eigen::Matrix4d polynomials = BasisPolynomials(trajectory.knots_s, interval);
  return {first, EvaluateBasis(polynomials, u_s, 0), EvaluateBasis(polynomials, u_s, 1)};
}

Eigen::Matrix3d CovarianceOf(const Trajectory& trajectory, const SplinePoint& point) {
  return CovarianceOfPoint(point.basis, [&](int a, int d) {
    return trajectory.covariances_m2[point.first + Index(a)][Index(d)];
  });
}

}  // namespace

TrajectoryRow Trajectory::At(TimeNs time_ns) const {
  const SplinePoint point = SplinePointAt(*this, time_ns);
  TrajectoryRow row;
  row.time_ns = time_ns;
  row.position_m = origin_m;
  for (std::size_t j = 0; j < 4; ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    row.position_m += point.basis[i] * control_points_m[point.first + j];
    row.velocity_mps += point.slope[i] * control_points_m[point.first + j];
  }
  row.sigma_m = CovarianceOf(*this, point).diagonal().cwiseMax(0.0).cwiseSqrt();
  return row;
}

Eigen::Matrix3d Trajectory::CovarianceAt(TimeNs time_ns) const {
  return CovarianceOf(*this, SplinePointAt(*this, time_ns));
}

Trajectory FitTrajectory(const std::vector<Measurement>& measurements,
                         const TrajectoryConfig& config) {
  Trajectory trajectory;
  TrajectoryFitter(config).Fit(measurements, trajectory);
  return trajectory;
}

Trajectory FitTrajectoryByCeres(const std::vector<Measurement>& measurements,
                                const TrajectoryConfig& config) {
  Trajectory trajectory;
  TrajectoryFitter(config, Minimiser::kCeres).Fit(measurements, trajectory);
  return trajectory;
}

Trajectory RefitTrajectory(const std::vector<Measurement>& measurements,
                           const TrajectoryScales& scales, const TrajectoryConfig& config) {
  Trajectory trajectory;
  TrajectoryFitter(config).Refit(measurements, scales, trajectory);
  return trajectory;
}

}  // namespace unlidar
