#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "base/voxel_numbers.hpp"

namespace unlidar {
namespace {

constexpr std::uint32_t kGrid = 5;

std::vector<Voxel> RandomVoxels(int count, std::int64_t reach) {
  std::mt19937 random(1);
  std::uniform_int_distribution<std::int64_t> index(-reach, reach);
  std::vector<Voxel> voxels;
  for (int i = 0; i < count; ++i) voxels.push_back({index(random), index(random), index(random)});
  return voxels;
}

TEST(VoxelBlocks, KnowTheSurroundingsOfEachVoxel) {
  for (const Voxel& voxel : RandomVoxels(200, 1000)) {
    VoxelBlocks blocks;
    blocks.Add(kGrid, KeyOf(voxel));
    for (int step = 0; step < 27; ++step) {
      const Voxel near = {voxel.x + step % 3 - 1, voxel.y + step / 3 % 3 - 1,
                          voxel.z + step / 9 - 1};
      EXPECT_TRUE(blocks.MayHaveAround(kGrid, near));
    }
  }
}

TEST(VoxelBlocks, KnowNearlyAllPlacesWithoutAny) {
  VoxelBlocks blocks;
  const std::vector<Voxel> voxels = RandomVoxels(2000, 100'000);
  for (const Voxel& voxel : voxels) blocks.Add(kGrid, KeyOf(voxel));
  int found = 0;
  for (const Voxel& voxel : voxels) {
    if (blocks.MayHaveAround(kGrid, {voxel.x + 9, voxel.y, voxel.z})) ++found;
    if (blocks.MayHaveAround(kGrid + 1, voxel)) ++found;
  }
  EXPECT_LT(found, 200);
  blocks.Clear();
  for (const Voxel& voxel : voxels) EXPECT_FALSE(blocks.MayHaveAround(kGrid, voxel));
}

}  // namespace
}  // namespace unlidar
