// Sets of occupied voxels: volume and overlap of point clouds.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace unlidar {

using VoxelKey = std::uint64_t;
using VoxelSet = std::vector<VoxelKey>;  // ascending, each voxel once

// The voxel of a point: 21 bits an axis of floor(coordinate / size). Points further out than 2^20
// voxels (210 km for voxels of 0.2 m) fall into the outermost ones.
inline VoxelKey VoxelOf(const Eigen::Vector3f& point_m, double voxel_size_m) {
  constexpr double kHalfRange = 1 << 20;
  VoxelKey key = 0;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const double cell = std::floor(static_cast<double>(point_m[axis]) / voxel_size_m);
    const double shifted = std::clamp(cell + kHalfRange, 0.0, 2.0 * kHalfRange - 1.0);
    key = (key << 21U) | static_cast<VoxelKey>(shifted);
  }
  return key;
}

inline VoxelSet UniqueVoxels(std::vector<VoxelKey> keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  return keys;
}

// V: the volume of the occupied voxels.
inline double VoxelVolumeM3(std::size_t voxels, double voxel_size_m) {
  return static_cast<double>(voxels) * voxel_size_m * voxel_size_m * voxel_size_m;
}

// Intersection over union of two sets of voxels; 0 for two empty sets.
inline double VoxelIou(const VoxelSet& a, const VoxelSet& b) {
  std::size_t shared = 0;
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    if (a[i] == b[j])
      ++shared, ++i, ++j;
    else if (a[i] < b[j])
      ++i;
    else
      ++j;
  }
  const std::size_t either = a.size() + b.size() - shared;
  return either == 0 ? 0.0 : static_cast<double>(shared) / static_cast<double>(either);
}

}  // namespace unlidar
