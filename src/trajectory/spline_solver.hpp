// The least squares of a spline model, solved by the normal equations in a time linear in its size.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "trajectory/banded.hpp"
#include "trajectory/spline_model.hpp"

namespace unlidar {

// Its memory is used again: nothing is taken for a model that is no larger than one before.
class SplineSolver {
 public:
  // Takes in the smoothness of a model, first of all.
  void SetSmoothness(const SplineModel& model);

  // Takes in its measurements at these weights, and its start.
  void SetMeasurements(const SplineModel& model, const std::vector<double>& weights);

  // Factorises the normal equations' matrix for one ratio sigma_a / k. Throws std::invalid_argument
  // where double precision is not enough.
  void Factorise(double ratio);

  // The same, and gives the control points of the minimum, until the next one.
  const std::vector<Eigen::Vector3d>& Minimise(double ratio);

  // Moves control points to that minimum, by a step from their residuals: what rounding costs is a
  // part of the step, not of the whole as in Minimise(). Gives the length of the point's that moved
  // farthest. For the matrix that was factorised last, with the weights of that.
  double Step(const SplineModel& model, const std::vector<double>& weights,
              std::vector<Eigen::Vector3d>& control_points_m);

  // log det of what the smoothness of a model that is as agile all along, and a first position and
  // velocity, known by 1 m and 1 m/s, say of the control points.
  double LogDeterminantOfSmoothness(const SplineModel& model);

  // Of the matrix that was factorised last.
  double LogDeterminant() const { return LogDeterminantBanded(factor_); }
  void Invert(BandedMatrix& inverse) const { InvertWithinBand(factor_, inverse); }

 private:
  BandedMatrix data_;
  BandedMatrix smoothness_;
  BandedMatrix factor_;
  double smoothness_weight_ = 1.0;  // in it
  std::vector<double> right_;       // that of the smoothness is zero
  std::vector<double> solution_;
  std::vector<Eigen::Vector4d> triangle_;
  std::vector<Eigen::Vector3d> control_points_m_;
};

}  // namespace unlidar
