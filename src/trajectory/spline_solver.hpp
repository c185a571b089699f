// Least squares of a spline model by banded normal equations, in a time linear in its size.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "trajectory/banded.hpp"
#include "trajectory/spline_model.hpp"

namespace unlidar {

// Reuses its memory: no allocation for a model no larger than an earlier one.
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
