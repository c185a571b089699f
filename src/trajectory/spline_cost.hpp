// The terms of a trajectory's fit as Ceres wants them.
#pragma once

#include <ceres/loss_function.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "trajectory/trajectory_model.hpp"

namespace unlidar {

// r = S (sum_j b_j c_j - z), so dr/dc_j = b_j S.
class SplineCost : public ceres::SizedCostFunction<3, 3, 3, 3, 3> {
 public:
  SplineCost(const SplineRow& row, double scale) : row_(row) { row_.sqrt_information *= scale; }

  bool Evaluate(const double* const* control, double* residual, double** jacobians) const override {
    Eigen::Vector3d position = -row_.value_m;
    for (int j = 0; j < 4; ++j) {
      position += row_.basis[j] * Eigen::Map<const Eigen::Vector3d>(control[j]);
    }
    Eigen::Map<Eigen::Vector3d>{residual} = row_.sqrt_information * position;
    for (int j = 0; jacobians != nullptr && j < 4; ++j) {
      if (jacobians[j] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{jacobians[j]} =
          row_.basis[j] * row_.sqrt_information;
    }
    return true;
  }

 private:
  SplineRow row_;
};

class TruncatedLossFunction : public ceres::LossFunction {
 public:
  explicit TruncatedLossFunction(double squared_limit) : squared_limit_(squared_limit) {}

  void Evaluate(double s, double rho[3]) const override {
    rho[0] = TruncatedLoss(s, squared_limit_);
    rho[1] = TruncatedWeight(s, squared_limit_);
    const bool bends = rho[1] > 0.0 && rho[1] < 1.0;
    rho[2] = bends ? -0.5 * (rho[1] + 1.0) / s : 0.0;
  }

 private:
  double squared_limit_;
};

}  // namespace unlidar
