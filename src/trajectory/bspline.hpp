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
  double margin_s = 0.0;  // extent of the spline before the first and after the last time
};

// Sets the knots for measurements at `times_s` (ascending, not empty): one interval each where the
// spacing allows it, so that none is smoothed over.
// Within a gap the spacing grows to a tenth of the distance to its end, which bounds the number of
// knots and keeps the problem well conditioned.
void PlaceKnots(const std::vector<double>& times_s, const KnotSpacing& spacing,
                std::vector<double>& knots_s);

// Returns the interval that contains the time, clamped to the first and last one.
int IntervalAt(const std::vector<double>& knots_s, double time_s);

// Returns the four basis functions of an interval as polynomials: (p, j) is the coefficient of
// (t - knots[interval + 3])^p for control point interval + j.
Eigen::Matrix4d BasisPolynomials(const std::vector<double>& knots_s, int interval);

// Returns values or derivatives (order 0 to 3) of the four basis functions at u_s after the start
// of the interval.
Eigen::Vector4d EvaluateBasis(const Eigen::Matrix4d& polynomials, double u_s, int derivative);

}  // namespace unlidar
