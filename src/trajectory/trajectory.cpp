#include "trajectory/trajectory.hpp"

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <new>
#include <utility>
#include <vector>

#include "base/memory_reserve.hpp"
#include "trajectory/agility.hpp"
#include "trajectory/bspline.hpp"
#include "trajectory/spline_cost.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {
namespace {

// Some destructors of Ceres allocate: to fail in one ends the program. What the whole takes is put
// aside before.
void SolveWithReserve(const ceres::Solver::Options& options, ceres::Problem* problem,
                      ceres::Solver::Summary* summary) {
  constexpr std::size_t kBytesPerResidualBlock = 4096;  // more than twice of what it is
  constexpr std::size_t kBytesAtLeast = 1U << 17U;
  const auto num_blocks = static_cast<std::size_t>(problem->NumResidualBlocks());
  const MemoryReserve reserve(kBytesAtLeast + kBytesPerResidualBlock * num_blocks);
  ceres::Solve(options, problem, summary);
  if (reserve.was_needed()) throw std::bad_alloc();
}

// The robust minimum itself, from a start that is nearly there.
void Refine(const SplineModel& model, const TrajectoryConfig& config, Trajectory& trajectory) {
  const TrajectoryScales& scales = trajectory.scales;
  const double limit = config.outlier_distance * scales.noise;
  TruncatedLossFunction loss(limit * limit);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.disable_all_safety_checks = true;
  ceres::Problem problem(problem_options);
  const auto add = [&](const SplineRow& row, double scale, ceres::LossFunction* row_loss) {
    auto* control = &trajectory.control_points_m[static_cast<std::size_t>(row.first)];
    problem.AddResidualBlock(new SplineCost(row, scale), row_loss, control[0].data(),
                             control[1].data(), control[2].data(), control[3].data());
  };
  for (const auto& row : model.measurements) add(row, 1.0, &loss);
  for (const auto& row : model.smoothness)
    add(row, scales.noise / scales.acceleration_mps2, nullptr);
  for (const auto& row : model.start) add(row, 1.0, nullptr);

  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  // Eigen's solver throws where an allocation fails; CHOLMOD returns null, which Ceres overlooks.
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  options.parameter_tolerance = 1e-13;  // relative to all control points: 1e-8 m is wanted
  options.max_num_iterations = 100;
  options.initial_trust_region_radius = 1e12;  // quadratic, but for the few on the edge of the loss
  ceres::Solver::Summary summary;
  SolveWithReserve(options, &problem, &summary);
  trajectory.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps;
  trajectory.converged = summary.termination_type == ceres::CONVERGENCE;
  trajectory.weights.clear();
  for (const auto& row : model.measurements) {
    const double s = Residual(row, trajectory.control_points_m).squaredNorm();
    trajectory.weights.push_back(TruncatedWeight(s, limit * limit));
  }
}

// From a fit at the same agility all along.
Trajectory Finish(const std::vector<Measurement>& measurements, SplineModel model, SplineFit fit,
                  const TrajectoryScales& scales, const TrajectoryConfig& config) {
  constexpr int kRounds = 2;  // a third changes sigmas by 1 %
  for (int round = 0; round < kRounds; ++round) {
    AdaptAgility(fit, scales, model);
    fit = FitRobust(model, scales, config);
  }
  Trajectory trajectory;
  trajectory.scales = scales;
  trajectory.origin_ns = measurements.front().time_ns;
  trajectory.duration_ns = measurements.back().time_ns - trajectory.origin_ns;
  trajectory.origin_m = model.origin_m;
  trajectory.knots_s = model.knots_s;
  trajectory.agility = model.agility;
  trajectory.control_points_m = std::move(fit.control_points_m);
  Refine(model, config, trajectory);
  trajectory.covariances_m2 = ControlPointCovariances(model, trajectory.weights, scales);
  return trajectory;
}

struct Site {
  std::size_t first = 0;
  Eigen::Vector4d basis = Eigen::Vector4d::Zero();
  Eigen::Vector4d slope = Eigen::Vector4d::Zero();
};

Site SiteAt(const Trajectory& trajectory, TimeNs time_ns) {
  const double time_s = static_cast<double>(time_ns - trajectory.origin_ns) * kSecondsPerNs;
  const int interval = IntervalAt(trajectory.knots_s, time_s);
  const auto first = static_cast<std::size_t>(interval);
  const double u_s = time_s - trajectory.knots_s[first + 3];
  const Eigen::Matrix4d polynomials = BasisPolynomials(trajectory.knots_s, interval);
  return {first, EvaluateBasis(polynomials, u_s, 0), EvaluateBasis(polynomials, u_s, 1)};
}

Eigen::Matrix3d CovarianceOf(const Trajectory& trajectory, const Site& site) {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t a = 0; a < 4; ++a) {
    for (std::size_t b = a; b < 4; ++b) {
      const double weight = site.basis[static_cast<Eigen::Index>(a)] *
                            site.basis[static_cast<Eigen::Index>(b)] * (a == b ? 0.5 : 1.0);
      const Eigen::Matrix3d& block = trajectory.covariances_m2[site.first + a][b - a];
      covariance += weight * (block + block.transpose());
    }
  }
  return covariance;
}

}  // namespace

TrajectoryRow Trajectory::At(TimeNs time_ns) const {
  const Site site = SiteAt(*this, time_ns);
  TrajectoryRow row;
  row.time_ns = time_ns;
  row.position_m = origin_m;
  for (std::size_t j = 0; j < 4; ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    row.position_m += site.basis[i] * control_points_m[site.first + j];
    row.velocity_mps += site.slope[i] * control_points_m[site.first + j];
  }
  row.sigma_m = CovarianceOf(*this, site).diagonal().cwiseMax(0.0).cwiseSqrt();
  return row;
}

Eigen::Matrix3d Trajectory::CovarianceAt(TimeNs time_ns) const {
  return CovarianceOf(*this, SiteAt(*this, time_ns));
}

Trajectory FitTrajectory(const std::vector<Measurement>& measurements,
                         const TrajectoryConfig& config) {
  // The scales decide what is an outlier and the outliers decide the scales: from several starts,
  // the most likely pair wins.
  constexpr std::array<double, 3> kStarts_mps2 = {1.0, 5.0, 25.0};
  const SplineModel model = BuildSplineModel(measurements, config);
  ScaleSearch best;
  for (const double start_mps2 : kStarts_mps2) {
    const ScaleSearch found =
        SearchScales(model, FitRobust(model, {start_mps2, 1.0}, config), config);
    if (start_mps2 == kStarts_mps2.front() || found.log_evidence > best.log_evidence) best = found;
  }
  SplineFit fit = FitRobust(model, best.scales, config);
  best = SearchScales(model, fit, config);
  fit = FitRobust(model, best.scales, config);
  return Finish(measurements, model, std::move(fit), best.scales, config);
}

Trajectory RefitTrajectory(const std::vector<Measurement>& measurements,
                           const TrajectoryScales& scales, const TrajectoryConfig& config) {
  const SplineModel model = BuildSplineModel(measurements, config);
  return Finish(measurements, model, FitRobust(model, scales, config), scales, config);
}

}  // namespace unlidar
