#include "io/turn_order.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "base/angles.hpp"

namespace unlidar {
namespace {

// Returns that are looked at to tell the order: enough that neighbours are less than half a turn
// apart, few enough to cost nothing where the order does not tell.
constexpr std::size_t kSampledReturns = 256;
// The beams of one shot differ in azimuth by up to this; so do the ends of a turn.
constexpr double kShotWidthRad = 10.0 * kRadPerDeg;

double TurnAzimuthRad(const Eigen::Vector3f& p) {
  return ApproximateAtan2(static_cast<double>(p.y()), static_cast<double>(p.x()));
}

double LessThanHalfATurnRad(double difference_rad) {
  return std::remainder(difference_rad, 2.0 * M_PI);
}

}  // namespace

void FindTurnShares(const std::vector<Eigen::Vector3f>& rows,
                    const std::vector<std::uint32_t>& return_rows, std::vector<float>* shares) {
  shares->clear();
  if (return_rows.size() < kSampledReturns) return;
  const std::size_t last = return_rows.size() - 1;
  const auto sampled = [&](std::size_t k) { return k * last / (kSampledReturns - 1); };
  std::array<double, kSampledReturns> azimuth_rad;  // of the samples
  std::array<double, kSampledReturns> turned_rad;   // since the first sample
  for (std::size_t k = 0; k < kSampledReturns; ++k) {
    azimuth_rad[k] = TurnAzimuthRad(rows[return_rows[sampled(k)]]);
    turned_rad[k] =
        k == 0 ? 0.0
               : turned_rad[k - 1] + LessThanHalfATurnRad(azimuth_rad[k] - azimuth_rad[k - 1]);
  }
  const double turn_rad = turned_rad.back();
  if (std::abs(std::abs(turn_rad) - 2.0 * M_PI) > kShotWidthRad) return;
  double farthest_rad = 0.0;
  for (const double rad : turned_rad) {
    const double forward_rad = std::copysign(1.0, turn_rad) * rad;
    farthest_rad = std::max(farthest_rad, forward_rad);
    if (farthest_rad - forward_rad > kShotWidthRad) return;
  }
  std::size_t k = 0;  // the sample before
  for (std::size_t i = 0; i <= last; ++i) {
    if (k + 1 < kSampledReturns && i == sampled(k + 1)) ++k;
    const double own_rad = TurnAzimuthRad(rows[return_rows[i]]);
    const double rad = turned_rad[k] + LessThanHalfATurnRad(own_rad - azimuth_rad[k]);
    shares->push_back(static_cast<float>(std::clamp(rad / turn_rad, 0.0, 1.0)));
  }
}

}  // namespace unlidar
