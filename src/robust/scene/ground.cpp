#include "robust/scene/ground.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace unlidar {
namespace {

// The height of a cell is a low quantile of its returns, so that strays below it do not count; a
// cell of fewer returns has none, and fewer cells bear no plane out.
constexpr double kQuantile = 0.05;
constexpr int kMinReturns = 10;
constexpr int kMinCells = 6;
// Cells as near to the plane as rough ground is make it. Ground rises above it by little: more is a
// bush, a car or the station itself; hollows are as deep as the relief, and deeper are reflections.
constexpr double kPlaneBandM = 0.6;
constexpr double kMaxRiseM = 0.5;
constexpr double kMaxReliefM = 1.5;

template <class Number>
double Quantile(std::vector<Number>* values, double share) {
  const auto k = static_cast<std::ptrdiff_t>(share * static_cast<double>(values->size() - 1));
  std::nth_element(values->begin(), values->begin() + k, values->end());
  return static_cast<double>((*values)[static_cast<std::size_t>(k)]);
}

}  // namespace

Ground::Ground(const PointsView& points_m, const GroundConfig& config) : config_(config) {
  std::map<std::pair<int, int>, std::vector<float>> heights;
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    const Eigen::Vector3f& p = points_m[i];
    heights[CellOf(static_cast<double>(p.x()), static_cast<double>(p.y()))].push_back(p.z());
  }
  std::vector<double> lowest;
  for (auto& [cell, z] : heights) {
    if (static_cast<int>(z.size()) < kMinReturns) continue;
    cells_[cell] = Quantile(&z, kQuantile);
    lowest.push_back(cells_[cell]);
  }
  if (static_cast<int>(lowest.size()) < kMinCells) return;

  // Iterated least squares on the lower half, then on what lies within the band of the plane.
  const double median = Quantile(&lowest, 0.5);
  std::map<std::pair<int, int>, double> inliers;
  for (const auto& [cell, z] : cells_) {
    if (z <= median) inliers[cell] = z;
  }
  for (int iteration = 0; iteration < 6; ++iteration) {
    if (static_cast<int>(inliers.size()) < kMinCells) return;
    Eigen::MatrixXd a(static_cast<Eigen::Index>(inliers.size()), 3);
    Eigen::VectorXd b(a.rows());
    Eigen::Index row = 0;
    for (const auto& [cell, z] : inliers) {
      a.row(row) << 1.0, (cell.first + 0.5) * config.cell_m, (cell.second + 0.5) * config.cell_m;
      b[row++] = z;
    }
    plane_ = a.colPivHouseholderQr().solve(b);
    inliers.clear();
    for (const auto& [cell, z] : cells_) {
      const Eigen::Vector3d at(1.0, (cell.first + 0.5) * config.cell_m,
                               (cell.second + 0.5) * config.cell_m);
      if (std::abs(z - plane_.dot(at)) < kPlaneBandM) inliers[cell] = z;
    }
  }
  exists_ = plane_.tail<2>().norm() < config.max_slope;
}

std::pair<int, int> Ground::CellOf(double x_m, double y_m) const {
  return {static_cast<int>(std::floor(x_m / config_.cell_m)),
          static_cast<int>(std::floor(y_m / config_.cell_m))};
}

double Ground::HeightAbove(const Eigen::Vector3f& point_m) const {
  if (!exists_) return std::numeric_limits<double>::infinity();
  const Eigen::Vector3d p = point_m.cast<double>();
  double ground_m = plane_.dot(Eigen::Vector3d(1.0, p.x(), p.y()));
  const auto cell = cells_.find(CellOf(p.x(), p.y()));
  if (cell != cells_.end() && std::abs(cell->second - ground_m) < kMaxReliefM) {
    ground_m = std::min(cell->second, ground_m + kMaxRiseM);
  }
  return p.z() - ground_m;
}

bool Ground::Holds(const Eigen::Vector3f& point_m) const {
  return HeightAbove(point_m) < config_.thickness_m;
}

}  // namespace unlidar
