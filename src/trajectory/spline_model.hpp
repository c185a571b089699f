// The linear-Gaussian model behind a trajectory: measurements and the smoothness prior as rows over
// the control points of a cubic B-spline over time, and their least squares.
//
// K knots, uneven and strictly increasing, carry K - 4 control points and K - 7 intervals; interval
// i is [knots[i + 3], knots[i + 4]) and depends on the control points i ... i + 3.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "trajectory/banded.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

// Limits of the spacing of knots, which follows that of the measurements: two sensors give 20 a
// second, and over more than the longer one the acceleration of a drone changes.
inline constexpr double kMinKnotSpacingS = 0.05;
inline constexpr double kMaxKnotSpacingS = 0.2;

// Sets the knots for measurements at `times_s` (ascending, not empty): one interval each where the
// spacing allows it, so that none is smoothed over. Within a gap the spacing grows to a tenth of
// the distance to its end, which bounds the number of knots and keeps the problem well conditioned.
// `margin_s`: extent of the spline before the first and after the last time.
void PlaceKnots(const std::vector<double>& times_s, double margin_s, std::vector<double>& knots_s);

// Returns the interval that contains the time, clamped to the first and last one.
int IntervalAt(const std::vector<double>& knots_s, double time_s);

// Returns the four basis functions of an interval as polynomials: (p, j) is the coefficient of
// (t - knots[interval + 3])^p for control point interval + j.
Eigen::Matrix4d BasisPolynomials(const std::vector<double>& knots_s, int interval);

// Returns values or derivatives (order 0 to 3) of the four basis functions at u_s after the start
// of the interval.
Eigen::Vector4d EvaluateBasis(const Eigen::Matrix4d& polynomials, double u_s, int derivative);

// Residual of a measurement or of the smoothness, shared by the banded solver and Ceres:
// r = S (sum_j b_j c_j - z) of four neighbouring control points c_j, so that dr/dc_j = b_j S, with
// S = sqrt_information and z = value_m.
struct SplineRow {
  int first = 0;  // index of c_0
  Eigen::Vector4d basis = Eigen::Vector4d::Zero();
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Identity();
  Eigen::Vector3d value_m = Eigen::Vector3d::Zero();
};

// `control`: the coordinates of each c_j.
inline Eigen::Vector3d Residual(const SplineRow& row, const double* const* control) {
  Eigen::Vector3d position = -row.value_m;
  for (int j = 0; j < 4; ++j) {
    position += row.basis[j] * Eigen::Map<const Eigen::Vector3d>(control[j]);
  }
  return row.sqrt_information * position;
}

// `control`: all control points of the spline.
inline Eigen::Vector3d Residual(const SplineRow& row, const std::vector<Eigen::Vector3d>& control) {
  const Eigen::Vector3d* const own = &control[static_cast<std::size_t>(row.first)];
  const std::array<const double*, 4> coordinates = {own[0].data(), own[1].data(), own[2].data(),
                                                    own[3].data()};
  return Residual(row, coordinates.data());
}

inline Eigen::Matrix3d Jacobian(const SplineRow& row, int j) {
  return row.basis[j] * row.sqrt_information;
}

// Derivatives of the spline at a point of an interval, over its control points.
struct SplineDerivatives {
  int first = 0;
  Eigen::Vector4d velocity = Eigen::Vector4d::Zero();
  Eigen::Vector4d acceleration = Eigen::Vector4d::Zero();
  Eigen::Vector4d jerk = Eigen::Vector4d::Zero();
  double weight_s = 0.0;  // of the point in an integral over time
};

// All scales are relative to the noise: the posterior of the noise scale k then has a closed form,
// and only the ratio sigma_a / k has to be searched.
struct SplineModel {
  Eigen::Vector3d origin_m = Eigen::Vector3d::Zero();
  std::vector<double> times_s;  // of the measurements, since the first
  std::vector<double> knots_s;
  std::vector<SplineRow> measurements;
  std::vector<SplineRow> start;                // weak prior of the first position and velocity
  std::vector<SplineDerivatives> derivatives;  // at the start, then two per interval

  double acceleration_time_s = 0.0;      // tau, by SetSmoothness(), as are:
  std::vector<Eigen::Matrix3d> agility;  // (intervals) relative sigma_a, identity
  std::vector<SplineRow> smoothness;     // (derivatives) for sigma_a = 1 m/s^2
  int num_control_points() const { return static_cast<int>(knots_s.size()) - 4; }
};

// Sets `model` except for its smoothness, reusing memory. Throws the same as TrajectoryFitter.
void BuildSplineModel(const std::vector<Measurement>& measurements, const TrajectoryConfig& config,
                      SplineModel& model);

// Sets the smoothness for a constant, isotropic agility and the correlation time tau of the
// acceleration.
void SetSmoothness(double acceleration_time_s, SplineModel& model);

// Least squares of a spline model by banded normal equations, in a time linear in its size. Reuses
// its memory: no allocation for a model no larger than an earlier one.
class SplineSolver {
 public:
  // Sets the smoothness of a model; to be called first.
  void SetSmoothness(const SplineModel& model);

  // Sets the measurements at these weights, and the start.
  void SetMeasurements(const SplineModel& model, const std::vector<double>& weights);

  // Factorises the normal matrix for one ratio sigma_a / k. Throws std::invalid_argument if double
  // precision is not enough.
  void Factorise(double ratio);

  // Factorises and returns the control points of the minimum, valid until the next call.
  const std::vector<Eigen::Vector3d>& Minimise(double ratio);

  // Moves control points to that minimum by a step from their residuals: rounding errors are
  // relative to the step, not to the positions as in Minimise(). Returns the largest movement of a
  // point. Uses the matrix factorised last, with the same weights.
  double Step(const SplineModel& model, const std::vector<double>& weights,
              std::vector<Eigen::Vector3d>& control_points_m);

  // log det of the information on the control points from the smoothness of a model of constant
  // agility and a first position and velocity known to 1 m and 1 m/s.
  double LogDeterminantOfSmoothness(const SplineModel& model);

  // Of the matrix factorised last.
  double LogDeterminant() const { return LogDeterminantBanded(factor_); }
  void Invert(BandedMatrix& inverse) const { InvertWithinBand(factor_, inverse); }

 private:
  BandedMatrix data_;
  BandedMatrix smoothness_;
  BandedMatrix factor_;
  double smoothness_weight_ = 1.0;  // included in factor_
  std::vector<double> right_;       // that of the smoothness is zero
  std::vector<double> solution_;
  std::vector<Eigen::Vector4d> triangle_;
  std::vector<Eigen::Vector3d> control_points_m_;
};

}  // namespace unlidar
