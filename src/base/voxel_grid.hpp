// Sets of occupied voxels: volume and overlap of point clouds.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

namespace unlidar {

using VoxelKey = std::uint64_t;
using VoxelSet = std::vector<VoxelKey>;  // ascending, each voxel once

// Index of a voxel along each axis.
struct Voxel {
  std::int64_t x = 0;
  std::int64_t y = 0;
  std::int64_t z = 0;
};

// Its floor: processors from before 2008, for which packages are built, have none.
inline std::int64_t FloorOf(double number) {
  const auto truncated = static_cast<std::int64_t>(number);
  return truncated - (static_cast<double>(truncated) > number ? 1 : 0);
}

// Returns the voxel of a point: floor(coordinate / size) along each axis, clamped to +-(2^20 - 2)
// (210 km for voxels of 0.2 m) so that every voxel has neighbours.
inline Voxel VoxelAt(const Eigen::Vector3f& point_m, double voxel_size_m) {
  constexpr double kOutermost = (1 << 20) - 2;
  const auto number = [&](float coordinate_m) {
    return FloorOf(
        std::clamp(static_cast<double>(coordinate_m) / voxel_size_m, -kOutermost, kOutermost));
  };
  return {number(point_m.x()), number(point_m.y()), number(point_m.z())};
}

// Packs the indices, 21 bits per axis.
inline VoxelKey KeyOf(const Voxel& voxel) {
  VoxelKey key = 0;
  for (const std::int64_t number : {voxel.x, voxel.y, voxel.z}) {
    key = (key << 21U) | static_cast<VoxelKey>(number + (1 << 20));
  }
  return key;
}

inline VoxelKey VoxelOf(const Eigen::Vector3f& point_m, double voxel_size_m) {
  return KeyOf(VoxelAt(point_m, voxel_size_m));
}

// Returns V, the volume of the occupied voxels.
inline double VoxelVolumeM3(std::size_t voxels, double voxel_size_m) {
  return static_cast<double>(voxels) * voxel_size_m * voxel_size_m * voxel_size_m;
}

// Returns the intersection over union of two sets of voxels; 0 for two empty sets.
inline double VoxelIou(const VoxelSet& a, const VoxelSet& b) {
  VoxelSet shared;
  std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(shared));
  const std::size_t either = a.size() + b.size() - shared.size();
  return either == 0 ? 0.0 : static_cast<double>(shared.size()) / static_cast<double>(either);
}

}  // namespace unlidar
