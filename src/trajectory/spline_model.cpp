#include "trajectory/spline_model.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace unlidar {
namespace {

// Weak prior of the first position and velocity, about the straight line through all measurements,
// as standard deviations.
constexpr double kPositionSigmaM = 1e4;
constexpr double kVelocitySigmaMps = 100.0;

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

// Adds a row to A and b of the normal equations A c = b: J_a' J_b and J_a' S z of its Jacobians J.
void AddRow(const SplineRow& row, double weight, BandedMatrix& matrix, std::vector<double>& right) {
  const Eigen::Matrix3d information =
      weight * row.sqrt_information.transpose() * row.sqrt_information;
  const Eigen::Vector3d force = information * row.value_m;
  for (int a = 0; a < 4; ++a) {
    Eigen::Map<Eigen::Vector3d>(&right[Index(3 * (row.first + a))]) += row.basis[a] * force;
    for (int c = 0; c < 3; ++c) {
      auto& column = matrix[Index(3 * (row.first + a) + c)];
      for (int r = c; r < 3; ++r) {
        column[r - c] += row.basis[a] * row.basis[a] * information(r, c);
      }
      for (int b = a + 1; b < 4; ++b) {
        for (int r = 0; r < 3; ++r) {
          column[3 * (b - a) + r - c] += row.basis[a] * row.basis[b] * information(r, c);
        }
      }
    }
  }
}

// Subtracts the gradient J' r of half the weighted square of a row.
void SubtractSlope(const SplineRow& row, double weight, const std::vector<Eigen::Vector3d>& control,
                   std::vector<double>& right) {
  const Eigen::Vector3d force = weight * row.sqrt_information.transpose() * Residual(row, control);
  for (int a = 0; a < 4; ++a) {
    Eigen::Map<Eigen::Vector3d>(&right[Index(3 * (row.first + a))]) -= row.basis[a] * force;
  }
}

}  // namespace

void PlaceKnots(const std::vector<double>& times_s, double margin_s, std::vector<double>& knots_s) {
  const int margin_intervals = static_cast<int>(std::ceil(margin_s / kMaxKnotSpacingS));
  // Three more knots on each side complete the basis of the outermost intervals.
  const int outer = std::max(1, margin_intervals) + 3;
  knots_s.clear();
  for (int i = outer; i > 0; --i) knots_s.push_back(times_s.front() - i * kMaxKnotSpacingS);
  knots_s.push_back(times_s.front());
  auto next = times_s.begin();
  while (knots_s.back() < times_s.back()) {
    const double knot_s = knots_s.back();
    while (next + 1 != times_s.end() && *next <= knot_s) ++next;
    const double gap_s =
        next == times_s.begin() ? 0.0 : std::min(knot_s - next[-1], *next - knot_s);
    knots_s.push_back(std::clamp(*next, knot_s + kMinKnotSpacingS,
                                 knot_s + std::max(kMaxKnotSpacingS, 0.1 * gap_s)));
  }
  const double end_s = knots_s.back();
  for (int i = 1; i <= outer; ++i) knots_s.push_back(end_s + i * kMaxKnotSpacingS);
}

int IntervalAt(const std::vector<double>& knots_s, double time_s) {
  const auto after = std::upper_bound(knots_s.begin() + 4, knots_s.end() - 4, time_s);
  return static_cast<int>(after - knots_s.begin()) - 4;
}

Eigen::Matrix4d BasisPolynomials(const std::vector<double>& knots_s, int interval) {
  // Cox-de Boor recursion on polynomials in u = t - origin. Column j of degree d is the basis
  // function that begins at knot interval + 3 - d + j.
  const auto at = [&](int i) {
    return knots_s[static_cast<std::size_t>(interval + i)] -
           knots_s[static_cast<std::size_t>(interval + 3)];
  };
  Eigen::Matrix4d basis = Eigen::Matrix4d::Zero();
  basis(0, 0) = 1.0;
  for (int degree = 1; degree <= 3; ++degree) {
    Eigen::Matrix4d raised = Eigen::Matrix4d::Zero();
    for (int j = 0; j < degree; ++j) {
      // The lower function spans knots [begin, end]: rising part of one function, falling part of
      // the other.
      const double begin = at(4 - degree + j);
      const double end = at(4 + j);
      const Eigen::Vector4d lower = basis.col(j) / (end - begin);
      Eigen::Vector4d times_u = Eigen::Vector4d::Zero();
      times_u.tail<3>() = lower.head<3>();
      raised.col(j) += end * lower - times_u;
      raised.col(j + 1) += times_u - begin * lower;
    }
    basis = raised;
  }
  return basis;
}

Eigen::Vector4d EvaluateBasis(const Eigen::Matrix4d& polynomials, double u_s, int derivative) {
  Eigen::RowVector4d powers = Eigen::RowVector4d::Zero();
  double power = 1.0;
  for (int p = derivative; p <= 3; ++p) {
    double factor = 1.0;
    for (int i = 0; i < derivative; ++i) factor *= p - i;
    powers[p] = factor * power;
    power *= u_s;
  }
  return (powers * polynomials).transpose();
}

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
  PlaceKnots(times_s, config.max_extrapolation_s, model.knots_s);

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

void SplineSolver::SetSmoothness(const SplineModel& model) {
  const int size = 3 * model.num_control_points();
  SetZeroBanded(size, smoothness_);
  right_.assign(Index(size), 0.0);
  for (const auto& row : model.smoothness) AddRow(row, 1.0, smoothness_, right_);
}

void SplineSolver::SetMeasurements(const SplineModel& model, const std::vector<double>& weights) {
  const int size = 3 * model.num_control_points();
  SetZeroBanded(size, data_);
  right_.assign(Index(size), 0.0);
  for (std::size_t i = 0; i < model.measurements.size(); ++i) {
    if (weights[i] > 0.0) AddRow(model.measurements[i], weights[i], data_, right_);
  }
  for (const auto& row : model.start) AddRow(row, 1.0, data_, right_);
}

// With few measurements and a stiff model the matrix is numerically singular; a ridge of relative
// size 1e-12 or more regularises it.
void SplineSolver::Factorise(double ratio) {
  smoothness_weight_ = 1.0 / (ratio * ratio);
  for (double ridge = 0.0; ridge < 1e-5; ridge = std::max(1e-12, 100.0 * ridge)) {
    factor_ = data_;
    for (std::size_t j = 0; j < factor_.size(); ++j) {
      factor_[j] += smoothness_weight_ * smoothness_[j];
      factor_[j][0] *= 1.0 + ridge;
    }
    if (FactoriseBanded(factor_)) return;
  }
  throw std::invalid_argument("trajectory: measurements too extreme for double precision");
}

const std::vector<Eigen::Vector3d>& SplineSolver::Minimise(double ratio) {
  Factorise(ratio);
  solution_ = right_;
  SolveBanded(factor_, solution_);
  control_points_m_.resize(solution_.size() / 3);
  for (std::size_t i = 0; i < control_points_m_.size(); ++i) {
    control_points_m_[i] = Eigen::Map<const Eigen::Vector3d>(&solution_[3 * i]);
  }
  return control_points_m_;
}

double SplineSolver::Step(const SplineModel& model, const std::vector<double>& weights,
                          std::vector<Eigen::Vector3d>& control_points_m) {
  solution_.assign(3 * control_points_m.size(), 0.0);
  for (std::size_t i = 0; i < model.measurements.size(); ++i) {
    if (weights[i] > 0.0) {
      SubtractSlope(model.measurements[i], weights[i], control_points_m, solution_);
    }
  }
  for (const auto& row : model.smoothness) {
    SubtractSlope(row, smoothness_weight_, control_points_m, solution_);
  }
  for (const auto& row : model.start) SubtractSlope(row, 1.0, control_points_m, solution_);
  SolveBanded(factor_, solution_);
  double longest_m = 0.0;
  for (std::size_t i = 0; i < control_points_m.size(); ++i) {
    const Eigen::Map<const Eigen::Vector3d> step_m(&solution_[3 * i]);
    control_points_m[i] += step_m;
    longest_m = std::max(longest_m, step_m.norm());
  }
  return longest_m;
}

// By QR decomposition of the rows: the smoothness between neighbours outweighs the start by so much
// over a minute that squared terms would lose all digits.
double SplineSolver::LogDeterminantOfSmoothness(const SplineModel& model) {
  const auto size = Index(model.num_control_points());
  triangle_.assign(size, Eigen::Vector4d::Zero());
  const auto add = [&](int first, Eigen::Vector4d basis) {
    for (std::size_t j = Index(first); j < Index(first + 4); ++j) {
      Eigen::Vector4d& known = triangle_[j];
      const double length = std::sqrt(known[0] * known[0] + basis[0] * basis[0]);
      if (length > 0.0) {
        const Eigen::Vector4d rest = (known[0] * basis - basis[0] * known) / length;
        known = (known[0] * known + basis[0] * basis).eval() / length;
        basis = rest;
      }
      basis = {basis[1], basis[2], basis[3], 0.0};
    }
  };
  // Rows in the order of their control points, so that later rows leave earlier triangles
  // unchanged.
  auto start = model.start.begin();
  for (const SplineRow& row : model.smoothness) {
    for (; start != model.start.end() && start->first <= row.first; ++start) {
      add(start->first, start->basis);
    }
    add(row.first, row.basis);
  }
  double sum = 0.0;
  for (const Eigen::Vector4d& row : triangle_) sum += std::log(std::abs(row[0]));
  return 2.0 * 3.0 * sum;  // three axes
}

}  // namespace unlidar
