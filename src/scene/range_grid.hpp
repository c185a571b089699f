// Occupancy over time in voxels whose size grows with range.
#pragma once

#include <Eigen/Core>
#include <cstddef>
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

// A reusable set of time bins, stored as bits. Emptying it visits one word per 64 bins between its
// lowest and highest bin.
class BinSet {
 public:
  explicit BinSet(std::size_t num_bins) : words_(num_bins / kBits + 1, 0) {}

  void Insert(std::uint32_t bin) {
    const std::size_t word = bin / kBits;
    words_[word] |= std::uint64_t{1} << (bin % kBits);
    if (word < first_) first_ = word;
    if (word >= last_) last_ = word + 1;
  }

  // Moves all bins to the end of `bins`, in ascending order.
  void MoveTo(std::vector<std::uint32_t>* bins);

 private:
  static constexpr std::size_t kBits = 64;

  std::vector<std::uint64_t> words_;
  std::size_t first_ = words_.size();  // words [first_, last_) may hold bins
  std::size_t last_ = 0;
};

// Counts of points per voxel and time bin; voxels and neighbourhoods are those of ShellTable.
//
// Memory and query time are proportional to the number of occupied (voxel, bin) pairs, independent
// of the total number of bins.
class RangeGrid {
 public:
  // kPerVoxel: of points of one voxel, counts after the first cost little where the bins are the
  // same and nothing was added since. It takes memory, and pays where voxels are wide.
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

  // Adds the bins in which the neighbourhood of `point_m` has points to `bins`.
  void InsertBins(const Eigen::Vector3f& point_m, BinSet* bins) const;

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

  // The last count of the neighbourhood of a voxel.
  struct Counted {
    std::uint32_t version = 0;  // of the grid, for which it holds
    std::int32_t count = 0;
    BinRange bins;
  };

  // Last counts that were computed: of all bins and of some.
  struct CountedTwice {
    Counted all;
    Counted some;
  };

  template <class Visit>
  void VisitBins(const Profile& profile, const Visit& visit) const;
  template <class CountOf>
  std::uint32_t SumAround(const Eigen::Vector3f& point_m, BinRange bins,
                          Counted CountedTwice::*which, const CountOf& count_of) const;
  std::uint32_t NewBinCount(const BinCount& value);
  void Free(std::uint32_t first);
  void NoteChange();

  CountCache count_cache_;
  ShellTable<Profile> places_;
  std::uint32_t version_ = 1;                  // counts up with each change
  mutable std::vector<CountedTwice> counted_;  // (voxels)
  // All but the latest, of all voxels: a grid that forgets as much as it adds needs no memory.
  std::vector<BinCount> bin_counts_;
  std::uint32_t free_ = kNone;  // first of those that are free, linked like the bins of a voxel
};

}  // namespace unlidar
