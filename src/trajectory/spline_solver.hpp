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

  // Control points of the minimum for one ratio sigma_a / k, until the next one. Throws
  // std::invalid_argument where double precision is not enough.
  const std::vector<Eigen::Vector3d>& Minimise(double ratio);

  // log det of what the smoothness of a model that is as agile all along, and a first position and
  // velocity, known by 1 m and 1 m/s, say of the control points.
  double LogDeterminantOfSmoothness(const SplineModel& model);

  // Of the matrix of the last minimum.
  double LogDeterminant() const { return LogDeterminantBanded(factor_); }
  void Invert(BandedMatrix& inverse) const { InvertWithinBand(factor_, inverse); }

 private:
  void FactoriseSum(double weight);

  BandedMatrix data_;
  BandedMatrix smoothness_;
  BandedMatrix factor_;
  std::vector<double> right_;  // that of the smoothness is zero
  std::vector<double> solution_;
  std::vector<Eigen::Vector4d> triangle_;
  std::vector<Eigen::Vector3d> control_points_m_;
};

}  // namespace unlidar
