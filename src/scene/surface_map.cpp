#include "scene/surface_map.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

constexpr double kMinEdgeM = 0.5;
constexpr double kEdgesPerRange = 12.0;  // the edge is at most a twelfth of the range
constexpr double kMaxRangeM = 120.0;     // beyond, cells hold too few returns
constexpr std::size_t kMostCells = 20'000;

constexpr double kMinCount = 8.0;
constexpr double kRefit = 1.3;  // a surface is computed again when so many times the returns are in
// Old returns fade, those placed by an early attitude first.
constexpr double kMaxCount = 100.0;

// Evenly filled cells have a standard deviation of 0.29 edges along each axis.
constexpr double kThin = 0.2;
constexpr double kNoiseM = 0.02;  // of a range

struct Place {
  std::uint32_t grid = 0;
  VoxelKey key = 0;
  double edge_m = 0.0;
  Eigen::Vector3d centre_m = Eigen::Vector3d::Zero();
};

Place PlaceOf(const Eigen::Vector3d& position_m, double range_m) {
  const int level = std::max(0, std::ilogb(range_m / (kEdgesPerRange * kMinEdgeM)));
  Place place;
  place.edge_m = std::ldexp(kMinEdgeM, level);
  place.grid = static_cast<std::uint32_t>(level);
  const Eigen::Array3d number = (position_m.array() / place.edge_m).floor();
  place.centre_m = (number + 0.5) * place.edge_m;
  const auto indices = number.cast<std::int64_t>().eval();
  place.key = KeyOf({indices[0], indices[1], indices[2]});
  return place;
}

}  // namespace

void SurfaceMap::Add(const Eigen::Vector3d& position_m) {
  const double range_m = position_m.norm();
  if (range_m > kMaxRangeM) return;
  const Place place = PlaceOf(position_m, range_m);
  if (cells_.size() >= kMostCells && numbers_.Find(place.grid, place.key) == VoxelNumbers::kNone) {
    return;
  }
  const std::uint32_t number = numbers_.FindOrAdd(place.grid, place.key);
  if (number == cells_.size()) cells_.emplace_back();
  Cell& cell = cells_[number];
  if (cell.count >= kMaxCount) {
    cell.count /= 2.0;
    cell.count_of_fit /= 2.0;
    cell.sum_m /= 2.0;
    cell.squares_m2 /= 2.0;
  }
  const Eigen::Vector3d offset_m = position_m - place.centre_m;
  ++cell.count;
  cell.sum_m += offset_m;
  cell.squares_m2 += offset_m * offset_m.transpose();
  if (cell.count < kMinCount || cell.count < kRefit * cell.count_of_fit) return;
  cell.count_of_fit = cell.count;
  const Eigen::Vector3d mean_m = cell.sum_m / cell.count;
  const Eigen::Matrix3d covariance_m2 = cell.squares_m2 / cell.count - mean_m * mean_m.transpose();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes;
  axes.computeDirect(covariance_m2);
  Surface& surface = cell.surface;
  surface.mean_m = place.centre_m + mean_m;
  surface.num_normals = 0;
  for (int axis = 0; axis < 3; ++axis) {  // in ascending order
    const double variance_m2 = std::max(axes.eigenvalues()[axis], 0.0) + kNoiseM * kNoiseM;
    if (variance_m2 > kThin * kThin * place.edge_m * place.edge_m) break;
    const auto normal = static_cast<std::size_t>(surface.num_normals++);
    surface.normals[normal] = axes.eigenvectors().col(axis);
    surface.variances_m2[normal] = variance_m2;
  }
}

const SurfaceMap::Surface* SurfaceMap::Find(const Eigen::Vector3d& position_m) const {
  const double range_m = position_m.norm();
  if (range_m > kMaxRangeM) return nullptr;
  const Place place = PlaceOf(position_m, range_m);
  const std::uint32_t number = numbers_.Find(place.grid, place.key);
  if (number == VoxelNumbers::kNone || cells_[number].surface.num_normals == 0) return nullptr;
  return &cells_[number].surface;
}

}  // namespace unlidar
