#include "collection/suspended.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "collection/body.hpp"
#include "tracking/flight.hpp"

namespace unlidar {
namespace {

// A nearer cable yields returns.
constexpr double kCableRangeM = 25.0;
// Straight motion explains at least this share of the variance of position.
constexpr double kStraightShare = 0.75;
// Quantile of a Gaussian that a static target exceeds in 1 of 1,000 cases.
constexpr double kQuantile = 3.09;

// Sum of the measurements of one block of time.
struct TimeBlock {
  double count = 0.0;
  Eigen::Array3d sum_m = Eigen::Array3d::Zero();
};

// Quantile of chi squared at kQuantile (Wilson and Hilferty).
double ChiSquared(double degrees) {
  const double variance = 2.0 / (9.0 * degrees);
  return degrees * std::pow(1.0 - variance + kQuantile * std::sqrt(variance), 3.0);
}

// `measurements`: at least one.
Eigen::Vector3d MeanOf(const std::vector<Measurement>& measurements) {
  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  for (const Measurement& m : measurements) mean_m += m.position_m;
  return mean_m / static_cast<double>(measurements.size());
}

double MinRangeM(const std::vector<Measurement>& measurements, const Eigen::Vector3d& mean_m) {
  double range_m = std::numeric_limits<double>::infinity();
  for (const Measurement& m : measurements) {
    range_m = std::min(range_m, (mean_m - m.viewpoint_m).norm());
  }
  return range_m;
}

}  // namespace

bool IsStaticFar(const std::vector<Measurement>& measurements) {
  const Eigen::Vector3d mean_m = MeanOf(measurements);
  const double range_m = MinRangeM(measurements, mean_m);
  double farthest_m = 0.0;
  for (const Measurement& m : measurements) {
    farthest_m = std::max(farthest_m, (m.position_m - mean_m).norm());
  }
  return range_m > kCableRangeM && farthest_m < kMinDisplacement.At(range_m);
}

// Analysis of variance: the means of blocks must differ by more than the scatter within them, which
// is at least the width of the beam, as a return may come from anywhere in it.
bool DriftsBeyondNoise(const std::vector<Measurement>& measurements) {
  const Eigen::Vector3d mean_m = MeanOf(measurements);
  const double range_m = MinRangeM(measurements, mean_m);
  const TimeNs begin_ns = measurements.front().time_ns;
  const double duration_s = SecondsOf(measurements.back().time_ns - begin_ns);
  if (duration_s <= 0.0) return false;
  const double num_blocks = std::max(2.0, std::floor(duration_s / kSwingPeriodS));
  std::vector<TimeBlock> blocks(static_cast<std::size_t>(num_blocks));
  const auto block_of = [&](const Measurement& m) -> TimeBlock& {
    const double share = SecondsOf(m.time_ns - begin_ns) / duration_s;
    return blocks[static_cast<std::size_t>(std::min(share * num_blocks, num_blocks - 1.0))];
  };
  for (const Measurement& m : measurements) {
    TimeBlock& at = block_of(m);
    at.count += 1.0;
    at.sum_m += (m.position_m - mean_m).array();
  }
  Eigen::Array3d within_m2 = Eigen::Array3d::Zero();
  for (const Measurement& m : measurements) {
    const TimeBlock& at = block_of(m);
    within_m2 += ((m.position_m - mean_m).array() - at.sum_m / at.count).square();
  }
  const auto num_seen = static_cast<double>(std::count_if(
      blocks.begin(), blocks.end(), [](const TimeBlock& at) { return at.count > 0.0; }));
  const double beam_m = kBeamSigmaRad * range_m;
  const double freedom = static_cast<double>(measurements.size()) - num_seen;
  within_m2 = (within_m2 / std::max(freedom, 1.0)).max(beam_m * beam_m);
  double between = 0.0;
  for (const TimeBlock& at : blocks) {
    if (at.count > 0.0) between += (at.sum_m.square() / (at.count * within_m2)).sum();
  }
  return between > ChiSquared(3.0 * (num_seen - 1.0));
}

// Constant velocity must explain most of the variance of position. Of objects that swing by 0.3 to
// 0.8 m at 0.2 to 0.6 Hz, sampled every half second, at most 3 in 100 ever pass.
bool MovesStraight(const std::vector<Measurement>& measurements) {
  const Eigen::Vector3d mean_m = MeanOf(measurements);
  const TimeNs begin_ns = measurements.front().time_ns;
  const auto seconds = [&](const Measurement& m) { return SecondsOf(m.time_ns - begin_ns); };
  const double duration_s = seconds(measurements.back());
  if (duration_s < kSwingPeriodS) return false;
  double mean_s = 0.0;
  for (const Measurement& m : measurements) mean_s += seconds(m);
  mean_s /= static_cast<double>(measurements.size());
  double square_s2 = 0.0;
  double square_m2 = 0.0;
  Eigen::Vector3d product_m_s = Eigen::Vector3d::Zero();
  for (const Measurement& m : measurements) {
    const double centred_s = seconds(m) - mean_s;
    const Eigen::Vector3d centred_m = m.position_m - mean_m;
    square_s2 += centred_s * centred_s;
    square_m2 += centred_m.squaredNorm();
    product_m_s += centred_s * centred_m;
  }
  const Eigen::Vector3d velocity_mps = product_m_s / square_s2;
  const double min_displacement_m = kMinDisplacement.At(MinRangeM(measurements, mean_m));
  return 2.0 * duration_s * velocity_mps.norm() > min_displacement_m &&
         velocity_mps.dot(product_m_s) > kStraightShare * square_m2;
}

}  // namespace unlidar
