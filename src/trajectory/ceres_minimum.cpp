// The minimum of a trajectory by Ceres, which nothing else here calls.
#include <ceres/evaluation_callback.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <new>
#include <vector>

#include "base/memory_reserve.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {
namespace {

constexpr double kNoTotalStepM = 1e-9;  // of all control points together

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

// Near the minimum the cost is constant up to rounding over micrometres, in a gap over more, and
// Ceres returns the point of the lowest cost. The gradient is the better criterion: it is smallest
// at the last accepted point.
class LastPoint : public ceres::EvaluationCallback {
 public:
  explicit LastPoint(const std::vector<Eigen::Vector3d>& control_points_m)
      : control_points_m_(control_points_m), last_m_(control_points_m) {}

  // Jacobians are evaluated at the start and at accepted points only.
  void PrepareForEvaluation(bool evaluate_jacobians, bool /*is_new_point*/) override {
    if (evaluate_jacobians) last_m_ = control_points_m_;
  }

  const std::vector<Eigen::Vector3d>& last_m() const { return last_m_; }

 private:
  const std::vector<Eigen::Vector3d>& control_points_m_;  // set by Ceres before an evaluation
  std::vector<Eigen::Vector3d> last_m_;
};

ceres::Solver::Options SolverOptions(int max_iterations,
                                     const std::vector<Eigen::Vector3d>& control_points_m) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  // Eigen's solver throws if an allocation fails; CHOLMOD returns null, which Ceres overlooks.
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  options.max_num_iterations = max_iterations;
  options.initial_trust_region_radius =
      1e12;  // quadratic, except for the few in the bent part of the loss
  // Terminates when no point moves any more. Until then a step is judged by the decrease of the
  // cost since the start, because its own decrease is lost in rounding.
  double squares_m2 = 0.0;
  for (const auto& point_m : control_points_m) squares_m2 += point_m.squaredNorm();
  options.parameter_tolerance = kNoTotalStepM / std::max(1.0, std::sqrt(squares_m2));
  options.function_tolerance = 0.0;
  options.gradient_tolerance = 0.0;
  options.use_nonmonotonic_steps = true;
  options.max_consecutive_nonmonotonic_steps = max_iterations;
  return options;
}

}  // namespace

MinimumReport MinimiseByCeres(const SplineModel& model, const TrajectoryScales& scales,
                              const TruncatedLoss& loss, int max_iterations,
                              std::vector<Eigen::Vector3d>& control_points_m) {
  // Ceres stops at two identical costs, whatever the step was: solve again in that case.
  constexpr int kMaxSolves = 4;
  constexpr std::size_t kBytesPerResidualBlock = 4096;  // more than twice the measured size
  constexpr std::size_t kBytesAtLeast = 1U << 17U;
  TruncatedLossFunction loss_function(loss);
  LastPoint last_point(control_points_m);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.disable_all_safety_checks = true;
  problem_options.evaluation_callback = &last_point;
  ceres::Problem problem(problem_options);
  const auto add = [&](const SplineRow& row, double scale, ceres::LossFunction* row_loss) {
    Eigen::Vector3d* const control = &control_points_m[Index(row.first)];
    problem.AddResidualBlock(new SplineCost(row, scale), row_loss, control[0].data(),
                             control[1].data(), control[2].data(), control[3].data());
  };
  for (const auto& row : model.measurements) add(row, 1.0, &loss_function);
  for (const auto& row : model.smoothness) {
    add(row, scales.noise / scales.acceleration_mps2, nullptr);
  }
  for (const auto& row : model.start) add(row, 1.0, nullptr);
  const ceres::Solver::Options options = SolverOptions(max_iterations, control_points_m);
  const auto num_blocks = static_cast<std::size_t>(problem.NumResidualBlocks());
  MinimumReport report;
  for (int solve = 0; solve < kMaxSolves; ++solve) {
    ceres::Solver::Summary summary;
    // Some destructors of Ceres allocate, and a failure there terminates the program. So the memory
    // of the whole solve is reserved beforehand.
    const MemoryReserve reserve(kBytesAtLeast + kBytesPerResidualBlock * num_blocks);
    ceres::Solve(options, &problem, &summary);
    if (reserve.was_needed()) throw std::bad_alloc();
    control_points_m = last_point.last_m();
    if (solve == 0) report.initial_cost = summary.initial_cost;
    report.final_cost = summary.final_cost;
    report.iterations += summary.num_successful_steps + summary.num_unsuccessful_steps;
    report.converged = summary.termination_type == ceres::CONVERGENCE;
    report.termination = ceres::TerminationTypeToString(summary.termination_type);
    if (!report.converged || summary.iterations.back().step_norm <= kNoTotalStepM) break;
  }
  return report;
}

}  // namespace unlidar
