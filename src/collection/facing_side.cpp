#include "collection/facing_side.hpp"

#include <algorithm>
#include <cmath>

#include "base/maths.hpp"

namespace unlidar {
namespace {

constexpr double kBallShare = 4.0 / 3.0;
// Flat bodies have shares of 0.2 to 0.4, the drone of seq0001 has 0.55, balls whose edges yield no
// returns have 1.7: whatever the returns tell is no better known than that.
constexpr double kShareSigma = 0.4;
// Before its returns tell, a target is a ball with this probability, and its share is uncertain by
// 0.5: the root mean square about 0.4 of two flat bodies, the drone of seq0001 and a ball.
constexpr double kBallPrior = 0.1;

// How fast the returns recede, over that of a ball.
struct Recession {
  double mean;
  double sigma;
};
constexpr Recession kBall{1.0, 0.25};
// A multicopter is seen through: a box that is filled with returns recedes by 0 from the front and
// by 0.47 over a corner.
constexpr Recession kFlat{0.2, 0.2};

// Returns the log likelihood of what was measured, up to a constant.
double LogLikelihood(const Recession& body, double measured, double variance) {
  variance += Square(body.sigma);
  return -0.5 * (Square(measured - body.mean) / variance + std::log(variance));
}

}  // namespace

void FacingSums::Add(const Eigen::Vector3d& offset_m) {
  const double across_m2 = Square(offset_m.y());
  count += 1.0;
  depth2_m2 += Square(offset_m.x());
  across2_m2 += across_m2;
  across4_m4 += Square(across_m2);
  depth_across2_m3 += offset_m.x() * across_m2;
}

void FacingSide::Add(const FacingSums& sums) {
  if (sums.count < 2.0) return;
  freedom_ += sums.count - 1.0;
  depth2_m2_ += sums.depth2_m2;
  variance_m4_ += sums.across4_m4 - Square(sums.across2_m2) / sums.count;
  covariance_m3_ += sums.depth_across2_m3;
}

FacingShare FacingSide::Share(double width_m, double flat_share) const {
  double ball = kBallPrior;
  if (freedom_ > 1.0 && variance_m4_ > 0.0) {
    const double slope_per_m = covariance_m3_ / variance_m4_;
    const double residual_m2 = depth2_m2_ - slope_per_m * covariance_m3_;
    const double variance = Square(4.0 * width_m) * residual_m2 / ((freedom_ - 1.0) * variance_m4_);
    const double recession = std::min(4.0 * width_m * slope_per_m, kBall.mean);
    const double log_odds = std::log(kBallPrior / (1.0 - kBallPrior)) +
                            LogLikelihood(kBall, recession, variance) -
                            LogLikelihood(kFlat, recession, variance);
    ball = 1.0 / (1.0 + std::exp(-log_odds));
  }
  // Nothing is moved until a ball is likelier than not.
  const double roundness = std::max(0.0, 2.0 * ball - 1.0);
  const double reach = kBallShare - flat_share;
  const double variance = ball * Square(1.0 - roundness) + (1.0 - ball) * Square(roundness);
  return {flat_share + reach * roundness, std::hypot(kShareSigma, reach * std::sqrt(variance))};
}

Eigen::Vector3d FacingSideOffsetM(double body_sigma_m, const Eigen::Vector3d& ray_m, double share) {
  return share * body_sigma_m * ray_m.stableNormalized();
}

}  // namespace unlidar
