#include "trajectory/spline_model.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "trajectory/banded.hpp"
#include "trajectory/bspline.hpp"

namespace unlidar {
namespace {

// Weak prior of the first position and velocity, about the straight line through all measurements,
// as standard deviations.
constexpr double kPositionSigmaM = 1e4;
constexpr double kVelocitySigmaMps = 100.0;
// Limits of the spacing of knots, which follows that of the measurements: two sensors give 20 a
// second, and over more than the longer one the acceleration of a drone changes.
constexpr double kMinKnotSpacingS = 0.05;
constexpr double kMaxKnotSpacingS = 0.2;

// Row at u_s after the start of an interval.
SplineRow RowAt(const Eigen::Matrix4d& polynomials, int interval, double u_s, int derivative) {
  SplineRow row;
  row.first = interval;
  row.basis = EvaluateBasis(polynomials, u_s, derivative);
  return row;
}

// Slope of the straight line through the measurements; zero if all have the same time.
Eigen::Vector3d MeanVelocity(const std::vector<Measurement>& measurements,
                             const std::vector<double>& times_s,
                             const Eigen::Vector3d& mean_position_m) {
  const double mean_s =
      std::accumulate(times_s.begin(), times_s.end(), 0.0) / static_cast<double>(times_s.size());
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  double spread_s2 = 0.0;
  for (std::size_t i = 0; i < times_s.size(); ++i) {
    moment += (times_s[i] - mean_s) * (measurements[i].position_m - mean_position_m);
    spread_s2 += (times_s[i] - mean_s) * (times_s[i] - mean_s);
  }
  return spread_s2 > 0.0 ? Eigen::Vector3d(moment / spread_s2) : Eigen::Vector3d::Zero();
}

}  // namespace

void BuildSplineModel(const std::vector<Measurement>& measurements, const TrajectoryConfig& config,
                      SplineModel& model) {
  if (measurements.empty()) throw std::invalid_argument("trajectory: no measurements");
  const TimeNs begin_ns = measurements.front().time_ns;
  std::vector<double>& times_s = model.times_s;
  times_s.clear();
  model.origin_m.setZero();
  for (const auto& measurement : measurements) {
    times_s.push_back(SecondsOf(measurement.time_ns - begin_ns));
    model.origin_m += measurement.position_m / static_cast<double>(measurements.size());
  }
  if (!model.origin_m.allFinite() || !std::is_sorted(times_s.begin(), times_s.end())) {
    throw std::invalid_argument("trajectory: measurements must be finite and in time order");
  }
  PlaceKnots(times_s, {kMinKnotSpacingS, kMaxKnotSpacingS, config.max_extrapolation_s},
             model.knots_s);

  const int num_intervals = static_cast<int>(model.knots_s.size()) - 7;
  model.derivatives.clear();
  for (int i = 0; i < num_intervals; ++i) {
    const Eigen::Matrix4d polynomials = BasisPolynomials(model.knots_s, i);
    const double length_s = model.knots_s[Index(i + 4)] - model.knots_s[Index(i + 3)];
    const auto add_derivatives = [&](double u_s, double weight_s) {
      model.derivatives.push_back({i, EvaluateBasis(polynomials, u_s, 1),
                                   EvaluateBasis(polynomials, u_s, 2),
                                   EvaluateBasis(polynomials, u_s, 3), weight_s});
    };
    if (i == 0) add_derivatives(0.0, 0.0);
    if (model.knots_s[Index(i + 3)] == 0.0) {
      model.start = {RowAt(polynomials, i, 0.0, 0), RowAt(polynomials, i, 0.0, 1)};
      model.start[0].sqrt_information /= kPositionSigmaM;
      model.start[1].sqrt_information /= kVelocitySigmaMps;
      model.start[1].value_m = MeanVelocity(measurements, times_s, model.origin_m);
    }
    // |a' + a / tau|^2 is the square of a linear function: two Gauss points are exact.
    for (const double side : {-1.0, 1.0}) {
      add_derivatives(0.5 * length_s * (1.0 + side / std::sqrt(3.0)), 0.5 * length_s);
    }
  }
  model.measurements.clear();
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    const int interval = IntervalAt(model.knots_s, times_s[i]);
    SplineRow row = RowAt(BasisPolynomials(model.knots_s, interval), interval,
                          times_s[i] - model.knots_s[Index(interval + 3)], 0);
    const Eigen::LLT<Eigen::Matrix3d> llt(measurements[i].covariance_m2);
    row.sqrt_information = llt.matrixL().solve(Eigen::Matrix3d::Identity());
    row.value_m = measurements[i].position_m - model.origin_m;
    if (llt.info() != Eigen::Success || !row.sqrt_information.allFinite()) {
      throw std::invalid_argument("trajectory: a covariance is not positive definite");
    }
    model.measurements.push_back(row);
  }
}

void SetSmoothness(double acceleration_time_s, SplineModel& model) {
  model.acceleration_time_s = acceleration_time_s;
  model.agility.assign(model.derivatives.size() / 2, Eigen::Matrix3d::Identity());
  model.smoothness.clear();
  for (const SplineDerivatives& point_derivatives : model.derivatives) {
    SplineRow row;
    row.first = point_derivatives.first;
    row.basis =
        model.smoothness.empty()
            ? point_derivatives.acceleration
            : std::sqrt(0.5 * acceleration_time_s * point_derivatives.weight_s) *
                  (point_derivatives.jerk + point_derivatives.acceleration / acceleration_time_s);
    model.smoothness.push_back(row);
  }
}

}  // namespace unlidar
