#include "trajectory/trajectory.hpp"

#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory_fitter.hpp"

namespace unlidar {
namespace {

struct SplinePoint {
  int first = 0;
  Eigen::Vector4d basis = Eigen::Vector4d::Zero();
  Eigen::Vector4d slope = Eigen::Vector4d::Zero();
};

SplinePoint SplinePointAt(const Trajectory& trajectory, TimeNs time_ns) {
  const double time_s = SecondsOf(time_ns - trajectory.origin_ns);
  const int interval = IntervalAt(trajectory.knots_s, time_s);
  const double u_s = time_s - trajectory.knots_s[Index(interval + 3)];
  const Eigen::Matrix4d polynomials = BasisPolynomials(trajectory.knots_s, interval);
  return {interval, EvaluateBasis(polynomials, u_s, 0), EvaluateBasis(polynomials, u_s, 1)};
}

}  // namespace

TrajectoryRow Trajectory::At(TimeNs time_ns) const {
  const SplinePoint point = SplinePointAt(*this, time_ns);
  TrajectoryRow row;
  row.time_ns = time_ns;
  row.position_m = origin_m;
  for (int j = 0; j < 4; ++j) {
    row.position_m += point.basis[j] * control_points_m[Index(point.first + j)];
    row.velocity_mps += point.slope[j] * control_points_m[Index(point.first + j)];
  }
  row.sigma_m =
      CovarianceOfSum(point.first, point.basis, covariance_m2).diagonal().cwiseMax(0.0).cwiseSqrt();
  return row;
}

Eigen::Matrix3d Trajectory::CovarianceAt(TimeNs time_ns) const {
  const SplinePoint point = SplinePointAt(*this, time_ns);
  return CovarianceOfSum(point.first, point.basis, covariance_m2);
}

Trajectory FitTrajectoryByCeres(const std::vector<Measurement>& measurements,
                                const TrajectoryConfig& config) {
  Trajectory trajectory;
  TrajectoryFitter(config, Minimiser::kCeres).Fit(measurements, trajectory);
  return trajectory;
}

}  // namespace unlidar
