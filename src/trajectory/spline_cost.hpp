// Residual and loss of a spline fit as Ceres cost and loss functions.
#pragma once

#include <ceres/loss_function.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "trajectory/spline_row.hpp"
#include "trajectory/truncated_loss.hpp"

namespace unlidar {

// Parameters: the four control points of the row, which must outlive it.
class SplineCost : public ceres::SizedCostFunction<3, 3, 3, 3, 3> {
 public:
  SplineCost(const SplineRow& row, double scale) : row_(row), scale_(scale) {}

  bool Evaluate(const double* const* control, double* residual, double** jacobians) const override {
    Eigen::Map<Eigen::Vector3d>{residual} = scale_ * Residual(row_, control);
    for (int j = 0; jacobians != nullptr && j < 4; ++j) {
      if (jacobians[j] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{jacobians[j]} =
          scale_ * Jacobian(row_, j);
    }
    return true;
  }

 private:
  const SplineRow& row_;
  double scale_;
};

class TruncatedLossFunction : public ceres::LossFunction {
 public:
  explicit TruncatedLossFunction(const TruncatedLoss& loss) : loss_(loss) {}

  void Evaluate(double s, double rho[3]) const override {
    rho[0] = loss_.Value(s);
    rho[1] = loss_.Weight(s);
    rho[2] = loss_.Curvature(s);
  }

 private:
  TruncatedLoss loss_;
};

}  // namespace unlidar
