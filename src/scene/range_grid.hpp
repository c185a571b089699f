// Occupancy over time in voxels whose size grows with range.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "scene/shell_table.hpp"

namespace unlidar {

// Time bins [first, last).
struct BinRange {
  std::uint32_t first = 0;
  std::uint32_t last = 0;

  friend bool operator==(const BinRange& a, const BinRange& b) {
    return a.first == b.first && a.last == b.last;
  }
};

// Counts of points per voxel and time bin; voxels and neighbourhoods are those of ShellTable.
//
// Memory and query time are proportional to the number of occupied (voxel, bin) pairs, independent
// of the total number of bins.
class RangeGrid {
 public:
  // kPerVoxel: of points of one voxel, counts after the first cost little where the bins are the
  // same and nothing was added since. It pays where voxels are wide.
  enum class CountCache { kNone, kPerVoxel };

  explicit RangeGrid(RangeRadius radius, CountCache count_cache = CountCache::kNone)
      : count_cache_(count_cache), places_(radius) {}

  // Adds a point `count` times; a negative count takes points added before away again.
  void Add(const Eigen::Vector3f& point_m, std::uint32_t bin, std::int32_t count = 1);

  // Forgets the points of earlier bins.
  void Forget(std::uint32_t before_bin);

  // Returns the number of points in the neighbourhood of `point_m`, in all bins or in `bins`.
  std::uint32_t Count(const Eigen::Vector3f& point_m) const;
  std::uint32_t Count(const Eigen::Vector3f& point_m, BinRange bins) const;

  // Returns the bins from the first to the last one in which the neighbourhood of `point_m`, not
  // empty, has points.
  BinRange SpanOf(const Eigen::Vector3f& point_m) const;

  // Volume of the neighbourhood of a point, m^3.
  double VolumeM3(const Eigen::Vector3f& point_m) const { return places_.VolumeM3(point_m); }

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  // Points of one voxel in one bin.
  struct BinCount {
    std::uint32_t bin = kNone;
    std::int32_t count = 0;
    std::uint32_t earlier = kNone;  // index of the next earlier one of the voxel
  };

  // Most voxels among strays have points in one bin only.
  struct Profile {
    std::int32_t total = 0;
    BinCount latest;
  };

  // A count of the neighbourhood of a voxel.
  struct Counted {
    std::uint64_t version = 0;  // of the grid, for which it holds
    std::uint32_t voxel = 0;
    std::int32_t count = 0;
    BinRange bins;
  };

  static constexpr std::size_t kNumCounted = 2048;  // more voxels than a frame has strays

  template <class Visit>
  void VisitBins(const Profile& profile, const Visit& visit) const;
  template <class CountOf>
  std::uint32_t SumAround(const Eigen::Vector3f& point_m, BinRange bins, std::size_t which,
                          const CountOf& count_of) const;
  std::uint32_t NewBinCount(const BinCount& value);
  void Free(std::uint32_t first);

  CountCache count_cache_;
  ShellTable<Profile> places_;
  std::uint64_t version_ = 1;  // counts up with each change
  // The last that were computed, of all bins and of some, by the voxel modulo kNumCounted.
  mutable std::vector<std::array<Counted, 2>> counted_;
  // All but the latest, of all voxels: a grid that forgets as much as it adds needs no memory.
  BlockQueue<BinCount> bin_counts_;
  std::uint32_t free_ = kNone;  // first of those that are free, linked like the bins of a voxel
};

}  // namespace unlidar
