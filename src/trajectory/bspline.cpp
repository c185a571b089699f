#include "trajectory/bspline.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace unlidar {

void PlaceKnots(const std::vector<double>& times_s, const KnotSpacing& spacing,
                std::vector<double>& knots_s) {
  const int margin_intervals = static_cast<int>(std::ceil(spacing.margin_s / spacing.max_s));
  // Three more knots on each side complete the basis of the outermost intervals.
  const int outer = std::max(1, margin_intervals) + 3;
  knots_s.clear();
  for (int i = outer; i > 0; --i) knots_s.push_back(times_s.front() - i * spacing.max_s);
  knots_s.push_back(times_s.front());
  const auto last = static_cast<std::ptrdiff_t>(times_s.size()) - 1;
  std::ptrdiff_t next = 0;
  while (knots_s.back() < times_s.back()) {
    const double knot_s = knots_s.back();
    while (next < last && times_s[static_cast<std::size_t>(next)] <= knot_s) ++next;
    const double gap_s = next == 0 ? 0.0
                                   : std::min(knot_s - times_s[static_cast<std::size_t>(next - 1)],
                                              times_s[static_cast<std::size_t>(next)] - knot_s);
    knots_s.push_back(std::clamp(times_s[static_cast<std::size_t>(next)], knot_s + spacing.min_s,
                                 knot_s + std::max(spacing.max_s, 0.1 * gap_s)));
  }
  const double end_s = knots_s.back();
  for (int i = 1; i <= outer; ++i) knots_s.push_back(end_s + i * spacing.max_s);
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

}  // namespace unlidar
