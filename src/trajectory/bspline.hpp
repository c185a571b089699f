// Cubic B-splines over time on uneven knots.
//
// K knots, strictly increasing, carry K - 4 control points and K - 7 intervals; interval i is
// [knots[i + 3], knots[i + 4]) and depends on the control points i ... i + 3.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace unlidar {

struct KnotSpacing {
  double min_s = 0.0;
  double max_s = 0.0;
  int measurements = 1;   // per interval, where the limits allow it
  double margin_s = 0.0;  // the spline goes on so far before the first and after the last time
};

// Sets the knots for measurements at `times_s` (ascending, not empty), fine where they are dense.
// Deep in a gap they may lie a tenth of the way to its end apart: their number stays in bounds, and
// the problem well conditioned, however long it is.
void PlaceKnots(const std::vector<double>& times_s, const KnotSpacing& spacing,
                std::vector<double>& knots_s);

// The interval that holds the time; the first or last one for times before or after all of them.
int IntervalAt(const std::vector<double>& knots_s, double time_s);

// The four basis functions of an interval as polynomials: element (p, j) is the coefficient of
// (t - knots[interval + 3])^p for control point interval + j.
Eigen::Matrix4d BasisPolynomials(const std::vector<double>& knots_s, int interval);

// Values or derivatives (order 0 to 3) of the four basis functions, u_s after the interval's begin.
Eigen::Vector4d EvaluateBasis(const Eigen::Matrix4d& polynomials, double u_s, int derivative);

}  // namespace unlidar
