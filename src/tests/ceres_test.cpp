// The robust minimum of a fit against the one that Ceres finds, with derivatives of its own.
#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/synthetic_recording.hpp"
#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {
namespace {

struct RowResidual {
  template <typename T>
  bool operator()(const T* a, const T* b, const T* c, const T* d, T* residual) const {
    Eigen::Matrix<T, 3, 1> error = -row.value_m.cast<T>();
    error += row.basis[0] * Eigen::Map<const Eigen::Matrix<T, 3, 1>>(a);
    error += row.basis[1] * Eigen::Map<const Eigen::Matrix<T, 3, 1>>(b);
    error += row.basis[2] * Eigen::Map<const Eigen::Matrix<T, 3, 1>>(c);
    error += row.basis[3] * Eigen::Map<const Eigen::Matrix<T, 3, 1>>(d);
    Eigen::Map<Eigen::Matrix<T, 3, 1>>{residual} = scale * (row.sqrt_information.cast<T>() * error);
    return true;
  }

  SplineRow row;
  double scale;
};

double TruncatedLoss(double s, double squared_limit) {
  if (s <= 0.5 * squared_limit) return s;
  if (s >= 2.0 * squared_limit) return squared_limit;
  return 2.0 * std::sqrt(2.0 * s * squared_limit) - squared_limit - s;
}

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

// Control points of the minimum that is nearest to `control_points_m`.
std::vector<Eigen::Vector3d> MinimumNear(std::vector<Eigen::Vector3d> control_points_m,
                                         const SplineModel& model, const TrajectoryScales& scales,
                                         const TrajectoryConfig& config) {
  const double limit = config.outlier_distance * scales.noise;
  ceres::Problem problem;
  const auto add = [&](const SplineRow& row, double scale, ceres::LossFunction* loss) {
    auto* const control = &control_points_m[static_cast<std::size_t>(row.first)];
    auto* const cost =
        new ceres::AutoDiffCostFunction<RowResidual, 3, 3, 3, 3, 3>(new RowResidual{row, scale});
    problem.AddResidualBlock(cost, loss, control[0].data(), control[1].data(), control[2].data(),
                             control[3].data());
  };
  for (const auto& row : model.measurements) {
    add(row, 1.0, new TruncatedLossFunction(limit * limit));
  }
  for (const auto& row : model.smoothness) {
    add(row, scales.noise / scales.acceleration_mps2, nullptr);
  }
  for (const auto& row : model.start) add(row, 1.0, nullptr);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.logging_type = ceres::SILENT;
  options.function_tolerance = 0.0;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 1e-13;
  options.max_num_iterations = 1000;
  options.initial_trust_region_radius = 1e12;  // quadratic, but for the few that the loss bends
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  EXPECT_TRUE(summary.IsSolutionUsable()) << summary.BriefReport();
  return control_points_m;
}

// A flight that turns, with outliers from a little to far beyond the limit of the loss.
std::vector<Measurement> MeasureFlight(testing::Random* random) {
  std::vector<Measurement> measurements;
  for (int i = 0; i < 80; ++i) {
    const double t = testing::kPeriodS * i;
    Measurement m;
    m.time_ns = testing::kBeginNs + i * testing::kPeriodNs;
    m.covariance_m2 = 0.01 * Eigen::Matrix3d::Identity();
    m.covariance_m2(0, 1) = m.covariance_m2(1, 0) = 0.004;
    m.position_m = Eigen::Vector3d(20.0 * std::cos(0.4 * t), 20.0 * std::sin(0.4 * t), 10.0 + t) +
                   random->NormalVector(0.1);
    if (i % 9 == 4) m.position_m += random->NormalVector(0.4);
    measurements.push_back(m);
  }
  return measurements;
}

TEST(CeresOracle, TheRobustMinimumIsTheOneThatCeresFinds) {
  const TrajectoryConfig config;
  constexpr TimeNs kStepNs = 20'000'000;
  std::ptrdiff_t num_partial = 0;
  for (const std::uint32_t seed : {1u, 2u, 3u, 4u, 5u, 6u, 7u, 8u}) {
    testing::Random random(seed);
    const std::vector<Measurement> measurements = MeasureFlight(&random);
    const Trajectory fitted = RefitTrajectory(measurements, {4.0, 1.0, 2.0}, config);
    EXPECT_TRUE(fitted.converged);
    num_partial += std::count_if(fitted.weights.begin(), fitted.weights.end(),
                                 [](double w) { return w > 0.0 && w < 1.0; });
    SplineModel model;
    BuildSplineModel(measurements, config, model);
    SetSmoothness(fitted.scales.acceleration_time_s, model);
    for (std::size_t i = 1; i < model.smoothness.size(); ++i) {
      model.smoothness[i].sqrt_information = fitted.agility[(i - 1) / 2].inverse();
    }
    std::vector<Eigen::Vector3d> start_m = fitted.control_points_m;
    for (auto& point_m : start_m) point_m += random.NormalVector(1e-3);
    Trajectory expected = fitted;
    expected.control_points_m = MinimumNear(start_m, model, fitted.scales, config);
    double largest_m = 0.0;
    for (TimeNs at_ns = fitted.begin_ns(); at_ns <= fitted.end_ns(); at_ns += kStepNs) {
      const Eigen::Vector3d difference_m =
          fitted.At(at_ns).position_m - expected.At(at_ns).position_m;
      largest_m = std::max(largest_m, difference_m.norm());
    }
    EXPECT_LT(largest_m, 1e-6) << "seed " << seed;
  }
  EXPECT_GT(num_partial, 8) << "else the loss is not tested where it bends";
}

TEST(CeresOracle, WeightIsTheDerivativeOfALossThatIsBounded) {
  constexpr double kLimit = 20.0;
  const TruncatedLossFunction loss(kLimit);
  for (const double s : {0.5, 9.0, 11.0, 20.0, 39.0, 41.0, 1e6}) {
    constexpr double kStep = 1e-4;
    double rho[3], low[3], high[3];
    loss.Evaluate(s, rho);
    loss.Evaluate(s - kStep, low);
    loss.Evaluate(s + kStep, high);
    EXPECT_NEAR(rho[1], (high[0] - low[0]) / (2.0 * kStep), 1e-5) << s;
    EXPECT_NEAR(rho[2], (high[1] - low[1]) / (2.0 * kStep), 1e-5) << s;
    EXPECT_LE(rho[0], kLimit);
  }
}

}  // namespace
}  // namespace unlidar
