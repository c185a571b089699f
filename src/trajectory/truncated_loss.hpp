// Robust loss of a measurement, for the banded solver and for Ceres.
#pragma once

#include <cmath>

namespace unlidar {

// The smooth truncated square of graduated non-convexity (Yang, Antonante, Tzoumas and Carlone,
// 2020, eq. 13 and 14 with mu = 1) of a squared residual s, with c^2 = squared_limit:
//   rho(s) = s                           up to c^2 / 2,
//            2 sqrt(2 c^2 s) - c^2 - s   up to 2 c^2,
//            c^2                         beyond.
// It is concave: rho'(s) is the weight of a measurement in reweighted least squares.
struct TruncatedLoss {
  double squared_limit;

  double Value(double s) const {
    if (IsInlier(s)) return s;
    if (IsOutlier(s)) return squared_limit;
    return 2.0 * std::sqrt(2.0 * squared_limit * s) - squared_limit - s;
  }

  // rho'
  double Weight(double s) const {
    if (IsInlier(s)) return 1.0;
    if (IsOutlier(s)) return 0.0;
    return std::sqrt(2.0 * squared_limit / s) - 1.0;
  }

  // rho''
  double Curvature(double s) const {
    if (IsInlier(s) || IsOutlier(s)) return 0.0;
    return -0.5 * std::sqrt(2.0 * squared_limit / s) / s;
  }

 private:
  bool IsInlier(double s) const { return s <= 0.5 * squared_limit; }
  bool IsOutlier(double s) const { return s >= 2.0 * squared_limit; }
};

}  // namespace unlidar
