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
  explicit RangeGrid(RangeRadius radius) : places_(radius) {}

  // Returns the number of the point's place: all points of a place share one neighbourhood. Places
  // are numbered from 0; some numbers belong to no point.
  std::uint32_t Add(const Eigen::Vector3f& point_m, std::uint32_t bin, std::uint32_t count = 1);

  // Prefetches the place of a point that will be added soon.
  void Prefetch(const Eigen::Vector3f& point_m) const { places_.Prefetch(point_m); }

  // Returns the number of points in the neighbourhood of `point_m`, in all bins or in `bins`.
  std::uint32_t Count(const Eigen::Vector3f& point_m) const;
  std::uint32_t Count(const Eigen::Vector3f& point_m, BinRange bins) const;

  // Adds the bins in which the neighbourhood of `point_m` has points to `bins`.
  void InsertBins(const Eigen::Vector3f& point_m, BinSet* bins) const;

  // Volume of the neighbourhood of a point, m^3.
  double VolumeM3(const Eigen::Vector3f& point_m) const { return places_.VolumeM3(point_m); }

  // Upper bound of place numbers, exclusive.
  std::uint32_t num_places() const { return places_.size(); }

 private:
  struct BinCount {
    std::uint32_t bin;
    std::uint32_t count;
  };

  static bool IsEarlier(const BinCount& a, std::uint32_t bin) { return a.bin < bin; }

  struct Profile {
    std::uint32_t total = 0;
    BinCount latest = {0, 0};    // last occupied bin, kept apart: most points fall into it
    std::vector<BinCount> bins;  // earlier occupied bins, ascending
  };

  ShellTable<Profile> places_;
};

}  // namespace unlidar
