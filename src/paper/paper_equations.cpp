// The equations of the paper's score, one function each.
#include <algorithm>
#include <cmath>

#include "paper/paper.hpp"

namespace unlidar {

double Density(std::size_t returns, double volume_m3) {
  return volume_m3 > 0.0 ? static_cast<double>(returns) / volume_m3 : 0.0;
}

double RelativeDensity(double local_per_m3, double merged_per_m3, DensityReading reading) {
  switch (reading) {
    case DensityReading::kMergedOverFrame:
      return merged_per_m3 / local_per_m3;
    case DensityReading::kRelativeDifference:
      return std::abs(local_per_m3 - merged_per_m3) / merged_per_m3;
    case DensityReading::kFrameOverMerged:
      break;
  }
  return local_per_m3 / merged_per_m3;
}

double DensitySummand(double relative_density, DensityTerm term) {
  constexpr double kLargestExponent = 600.0;
  return term == DensityTerm::kLinear ? relative_density
                                      : std::exp(std::min(relative_density, kLargestExponent));
}

double IouSummand(double iou, IouTerm term, double min_iou) {
  const double floored = std::max(iou, min_iou);
  switch (term) {
    case IouTerm::kInverse:
      return 1.0 / floored;
    case IouTerm::kComplement:
      return 1.0 - iou;
    case IouTerm::kLogarithm:
      break;
  }
  return -std::log(floored);
}

double Accumulate(const std::vector<double>& summands, Accumulation accumulation) {
  if (summands.empty()) return 0.0;
  double sum = 0.0;
  for (const double summand : summands) sum += summand;
  return accumulation == Accumulation::kSum ? sum : sum / static_cast<double>(summands.size());
}

double Psi(double psi_rho, double psi_iou, double lambda) { return psi_rho + lambda * psi_iou; }

double VonNeumannRatio(const std::vector<Eigen::Vector3d>& centroids_m) {
  constexpr double kOfWhiteJitter = 2.0;
  if (centroids_m.size() < 2) return kOfWhiteJitter;
  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& c : centroids_m) mean_m += c;
  mean_m /= static_cast<double>(centroids_m.size());
  double steps_m2 = 0.0;
  double spread_m2 = (centroids_m[0] - mean_m).squaredNorm();
  for (std::size_t i = 1; i < centroids_m.size(); ++i) {
    steps_m2 += (centroids_m[i] - centroids_m[i - 1]).squaredNorm();
    spread_m2 += (centroids_m[i] - mean_m).squaredNorm();
  }
  // Both are means over n - 1. A spread below a nanometre is rounding error.
  return spread_m2 > 1e-18 ? steps_m2 / spread_m2 : kOfWhiteJitter;
}

}  // namespace unlidar
