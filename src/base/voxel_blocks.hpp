// Tells quickly that no voxel is about a place.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/voxel_grid.hpp"
#include "base/voxel_numbers.hpp"

namespace unlidar {

// Blocks of 4 x 4 x 4 voxels that have some: one bit for all blocks of the same hash. They fit into
// the cache, which the voxels exceed.
class VoxelBlocks {
 public:
  void Add(std::uint32_t grid, VoxelKey key) {
    const std::size_t bit = BitOf(grid, key);
    words_[bit / kWordBits] |= WordOf(bit);
  }

  // Returns false if no voxel was added that is at most one away along each axis.
  bool MayHaveAround(std::uint32_t grid, const Voxel& voxel) const {
    for (const int dx : {-1, 1}) {
      for (const int dy : {-1, 1}) {
        for (const int dz : {-1, 1}) {
          const std::size_t bit = BitOf(grid, KeyOf({voxel.x + dx, voxel.y + dy, voxel.z + dz}));
          if ((words_[bit / kWordBits] & WordOf(bit)) != 0) return true;
        }
      }
    }
    return false;
  }

  void Clear() { std::fill(words_.begin(), words_.end(), 0); }

 private:
  static constexpr std::size_t kWordBits = 64;
  static constexpr std::size_t kNumBits = std::size_t{1} << 18U;
  // Of each index the bits within a block.
  static constexpr VoxelKey kWithinBlock = (VoxelKey{3} << 42U) | (VoxelKey{3} << 21U) | 3U;

  static std::size_t BitOf(std::uint32_t grid, VoxelKey key) {
    return VoxelNumbers::HashOf(grid, key & ~kWithinBlock) % kNumBits;
  }
  static std::uint64_t WordOf(std::size_t bit) { return std::uint64_t{1} << (bit % kWordBits); }

  std::vector<std::uint64_t> words_ = std::vector<std::uint64_t>(kNumBits / kWordBits);
};

}  // namespace unlidar
